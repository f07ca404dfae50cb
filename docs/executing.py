"""Pages in Markdown that write pictures are run when the site is built, and show what they write.

A page's Python blocks are run in their order, as the tests run them (`tests/test_docs.py`). A
picture that a block saves stands behind it; one that the page itself shows, as
``figures/NAME.png``, is taken from the block that writes ``NAME.png``.
"""

import re
import shutil
import tempfile
from contextlib import chdir, redirect_stdout
from io import StringIO
from pathlib import Path
from textwrap import dedent

from matplotlib import pyplot

BLOCK = re.compile(r"^( *)```python\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)
MADE = Path(__file__).parent / "made"


def run(app, page, content):
    """Run a page that saves pictures, and put them behind the blocks that do."""
    if not int(app.config.sphinx_gallery_conf.get("plot_gallery", True)):
        return  # asked for without anything that is run: to look at links, say
    text = content[0]
    source = Path(app.env.doc2path(page))
    if source.suffix != ".md" or "savefig(" not in text:
        return
    up = "../" * page.count("/")
    namespace = {"__name__": "__main__"}
    parts, last, shown = [], 0, {}
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        for match in BLOCK.finditer(text):
            before = {path: path.stat().st_mtime_ns for path in Path().glob("*.png")}
            code = "\n" * text.count("\n", 0, match.start(2)) + dedent(match.group(2))
            with redirect_stdout(StringIO()):
                exec(compile(code, str(source), "exec"), namespace)
            pyplot.close("all")
            parts.append(text[last : match.end()])
            last = match.end()
            for path in sorted(Path().glob("*.png")):
                if before.get(path) == path.stat().st_mtime_ns:
                    continue
                name = f"{page.replace('/', '_')}_{path.name}"
                MADE.mkdir(exist_ok=True)
                shutil.copy(path, MADE / name)
                if f"({up}figures/{path.name})" in text:
                    shown[f"({up}figures/{path.name})"] = f"({up}made/{name})"
                else:
                    parts.append(f"\n\n{match.group(1)}![{path.stem}]({up}made/{name})\n")
    content[0] = "".join([*parts, text[last:]])
    for old, new in shown.items():
        content[0] = content[0].replace(old, new)


def setup(app):
    app.connect("source-read", run)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
