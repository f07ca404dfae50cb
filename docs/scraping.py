"""What the gallery takes from an example beside its text: the pictures that it writes."""

import shutil
from pathlib import Path

from comparing import check
from sphinx_gallery.scrapers import figure_rst


def pictures(block, block_vars, gallery_conf):
    """Move the PNG files that a block of an example has written into its page, if they look right."""
    written = Path(block_vars["src_file"]).parent.glob("*.png")
    written = sorted(written, key=lambda path: path.stat().st_mtime_ns)
    for path in written:
        check(path)
    places = [str(next(block_vars["image_path_iterator"])) for _ in written]
    for path, place in zip(written, places, strict=True):
        shutil.move(path, place)
    return figure_rst(places, gallery_conf["src_dir"])
