"""Pages in Markdown are run when the site is built, and show what their blocks print and draw.

A page's Python blocks are run in their order, as the tests run them (`tests/test_docs.py`). Below a
block stands what it prints, and a picture that it saves; one that the page itself shows, as
``figures/NAME.png``, is taken from the block that writes ``NAME.png``. An assertion is checked, and
shown as its quantity with the value.
"""

import ast
import re
import shutil
import tempfile
from contextlib import chdir, redirect_stdout
from io import StringIO
from pathlib import Path
from textwrap import dedent, indent

from matplotlib import pyplot

BLOCK = re.compile(r"^( *)```python\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)
MADE = Path(__file__).parent / "made"
CLOSE = {"allclose", "isclose", "approx"}  # functions whose first argument is the quantity
MOST = 72  # characters of a value beside its quantity


def quantity(test):
    """Return the part of a test that is a quantity worth showing, or None."""
    match test:
        case ast.Compare(ops=[ast.In() | ast.NotIn() | ast.Is() | ast.IsNot()]):
            return None
        case ast.Compare(left=left, comparators=others):
            return quantity(left if not isinstance(left, ast.Constant) else others[0])
        case ast.Call(func=ast.Name(id="abs"), args=[ast.BinOp(left=left, op=ast.Sub())]):
            return left
        case ast.Call(func=ast.Attribute(attr=name), args=[first, *_]) if name in CLOSE:
            return None if isinstance(first, ast.Starred) else first
        case ast.Constant():
            return None
    return test


def text_of(value):
    """Return a value as it stands beside its quantity: numbers with six digits."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, tuple | list):
        return f"{', '.join(map(text_of, value))}"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def run_block(code, source, line, namespace):
    """Run a block; return it as it is shown, and what it prints."""
    tree, values, printed = ast.parse(code), {}, StringIO()
    quantities = {}
    for number, statement in enumerate(tree.body):
        if isinstance(statement, ast.Assert):
            part, quantities[number] = quantity(statement.test), ""
            if part is not None:
                segment = ast.get_source_segment(code, part)
                quantities[number] = ast.unparse(part) if "\n" in segment else segment
                call = ast.Call(ast.Name("_shown", ast.Load()), [ast.Constant(number), part], [])
                statement.test = Replacing(part, call).visit(statement.test)
    namespace["_shown"] = lambda number, value: values.setdefault(number, value)
    ast.fix_missing_locations(ast.increment_lineno(tree, line))
    with redirect_stdout(printed):
        exec(compile(tree, str(source), "exec"), namespace)
    lines = code.splitlines()
    for number, name in reversed(quantities.items()):
        statement = tree.body[number]
        first, last = statement.lineno - line - 1, statement.end_lineno - line
        text = text_of(values[number]) if number in values else ""
        is_short = "\n" not in text and 0 < len(text) <= MOST
        lines[first:last] = [f"{name}  # {text}"] if is_short else []
    return "\n".join(lines).strip("\n"), printed.getvalue()


class Replacing(ast.NodeTransformer):
    """Replacement of one node of a tree."""

    def __init__(self, old, new):
        self.old, self.new = old, new

    def visit(self, node):
        return self.new if node is self.old else super().visit(node)


def run(app, page, content):
    """Run a page with Python blocks, and put below each what it prints and draws."""
    if not int(app.config.sphinx_gallery_conf.get("plot_gallery", True)):
        return  # asked for without anything that is run: to look at links, say
    text = content[0]
    source = Path(app.env.doc2path(page))
    if source.suffix != ".md":
        return
    up = "../" * page.count("/")
    namespace = {"__name__": "__main__"}
    parts, last, shown = [], 0, {}
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        for match in BLOCK.finditer(text):
            before = {path: path.stat().st_mtime_ns for path in Path().glob("*.png")}
            line, margin = text.count("\n", 0, match.start(2)), match.group(1)
            code, printed = run_block(dedent(match.group(2)), source, line, namespace)
            pyplot.close("all")
            blocks = [f"```python\n{code}\n```"] if code else []
            blocks += [f"```text\n{printed.rstrip()}\n```"] if printed.strip() else []
            parts += [text[last : match.start()], indent("\n\n".join(blocks), margin)]
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
                    parts.append(f"\n\n{margin}![{path.stem}]({up}made/{name})\n")
    content[0] = "".join([*parts, text[last:]])
    for old, new in shown.items():
        content[0] = content[0].replace(old, new)


def setup(app):
    app.connect("source-read", run)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
