"""Formulas as MathML, which browsers show by themselves: no script of others, no network."""

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.errors import SphinxError
from sphinx.util.math import get_node_equation_number


def inline(self, node):
    """Write a formula within a line."""
    self.body.append(mathml(node, as_block=False))
    raise nodes.SkipNode


def display(self, node):
    """Write a formula of its own, with its number."""
    self.body.append(self.starttag(node, "div", CLASS="math notranslate nohighlight"))
    if node["number"]:
        self.body.append(f'<span class="eqno">({get_node_equation_number(self, node)})')
        self.add_permalink_ref(node, "Link to this equation")
        self.body.append("</span>")
    self.body.append(mathml(node, as_block=True))
    self.body.append("</div>")
    raise nodes.SkipNode


def mathml(node, as_block):
    """Return a formula as MathML, or say which one cannot be."""
    text = node.astext()
    try:
        return tex2mathml(text, as_block=as_block)
    except Exception as error:  # whatever Docutils raises of a formula that it does not know
        raise SphinxError(f"docutils makes no MathML of {text!r}: {error}") from error


def setup(app):
    app.add_html_math_renderer("mathml", (inline, None), (display, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
