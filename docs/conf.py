"""How Sphinx builds these pages and the gallery: ``python -m sphinx docs docs/_build/html``."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))  # for scraping

project = "mems_impact"
author = "mems_impact developers"

extensions = ["myst_parser", "sphinx.ext.mathjax", "sphinx_gallery.gen_gallery"]
exclude_patterns = ["_build", "examples", "sg_execution_times.rst"]
html_theme = "alabaster"
myst_heading_anchors = 3  # links lead to headings, as on a forge

sphinx_gallery_conf = {
    "examples_dirs": "examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",  # all of them are run
    "within_subsection_order": "FileNameSortKey",
    "image_scrapers": ("scraping.pictures",),
    "reset_modules": (),
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_signature": False,
}
