"""How Sphinx builds these pages, the reference and the gallery.

``python -m sphinx docs docs/_build/html``
"""

import re
import sys
from contextlib import suppress
from pathlib import Path
from urllib.request import urlopen

sys.path.insert(0, str(Path(__file__).parent))  # for executing, formulas, scraping and signatures

from numpydoc.xref import DEFAULT_LINKS

import mems_impact as mi

project = "mems_impact"
author = "mems_impact developers"

extensions = [
    "executing",
    "formulas",
    "myst_parser",
    "numpydoc",
    "signatures",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.intersphinx",
    "sphinx.ext.viewcode",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = [
    "_build",
    "examples",
    "tutorials",
    "ideas",
    "names.rst",
    "templates",
    "sg_execution_times.rst",
]
nitpicky = True  # a reference that leads nowhere is a warning, and a warning an error
numfig = True
html_math_renderer = "mathml"
math_numfig = True
math_eqref_format = "({number})"

html_theme = "pydata_sphinx_theme"
html_title = "mems_impact"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_logo = html_favicon = "static/logo.svg"
html_show_sourcelink = False
html_theme_options = {
    "navigation_with_keys": False,
    "logo": {"text": "mems_impact"},
    "show_toc_level": 2,
    "secondary_sidebar_items": ["page-toc"],
}

myst_heading_anchors = 3  # links lead to headings, as on a forge
myst_enable_extensions = ["amsmath", "colon_fence", "dollarmath"]

templates_path = ["templates"]


def section(block):
    """Return a section of the reference from one of the list of public names."""
    title, *text = re.findall("^# (.*)", block, re.MULTILINE)
    names = re.findall(r"^from .* as (\w+)$", block, re.MULTILINE)
    options = (".. autosummary::", "   :toctree: reference", "   :nosignatures:")
    rows = (f"   {name}" for name in names)
    return "\n".join([title, "-" * len(title), "", *text, "", *options, "", *rows, ""])


_, *blocks, _ = Path(mi.__file__).with_name("__init__.pyi").read_text("utf-8").split("\n\n")
NAMES = Path(__file__).with_name("names.rst")
NAMES.write_text("\n".join([".. currentmodule:: mems_impact\n", *map(section, blocks)]), "utf-8")
autosummary_generate = [NAMES.name]
# `Basins` and `basins` would be one file where case does not count.
autosummary_filename_map = {
    f"mems_impact.{name}": f"mems_impact.{name}-class"
    for name in mi.__all__
    if name[0].isupper() and name.lower() in mi.__all__
}
autodoc_typehints = "none"  # the docstrings give the types
autodoc_member_order = "groupwise"
numpydoc_show_class_members = False  # autodoc shows them, with their docstrings
numpydoc_attributes_as_param_list = True
DEFAULT_LINKS.clear()  # Python's own types
numpydoc_xref_param_type = True
numpydoc_xref_ignore = "all"  # but for these
numpydoc_xref_aliases = {
    "array": "numpy.ndarray",
    "Axes": "matplotlib.axes.Axes",
    "DataFrame": "pandas.DataFrame",
    "Generator": "numpy.random.Generator",
    "SeedSequence": "numpy.random.SeedSequence",
}


def inventory(name, address):
    """Return the file with another project's list of objects, read once; of an earlier build offline."""
    file = Path(__file__).with_name("_build") / f"{name}.inv"
    with suppress(OSError):
        content = urlopen(f"{address}objects.inv", timeout=5).read()
        file.parent.mkdir(exist_ok=True)
        file.write_bytes(content)
    return str(file) if file.exists() else None


others = {
    "matplotlib": "https://matplotlib.org/stable/",
    "numpy": "https://numpy.org/doc/stable/",
    "pandas": "https://pandas.pydata.org/docs/",
}
inventories = {name: inventory(name, address) for name, address in others.items()}
intersphinx_mapping = {name: (others[name], file) for name, file in inventories.items() if file}
# Without a list the names of others are no links.
unread = "|".join(others.keys() - intersphinx_mapping.keys())
nitpick_ignore_regex = [("py:.*", rf"({unread})\..*")] if unread else []

# Links to elsewhere, each in turn, with time to answer.
linkcheck_timeout = 30
linkcheck_retries = 2
linkcheck_workers = 2
linkcheck_ignore = [r"http://127\.0\.0\.1"]  # of the explorer

sphinx_gallery_conf = {
    "examples_dirs": ["tutorials", "ideas", "examples"],
    "gallery_dirs": ["learn", "concepts", "gallery"],
    "filename_pattern": r"\.py$",  # all of them are run
    "within_subsection_order": "FileNameSortKey",
    "image_scrapers": ("scraping.pictures",),
    "reset_modules": (),
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_signature": False,
    "thumbnail_size": (680, 560),  # px: the width of a card of a screen with two pixels per point
    "backreferences_dir": "reference/examples",
    "doc_module": ("mems_impact",),
}
