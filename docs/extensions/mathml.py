"""Formulas as MathML, which browsers draw by themselves: no script, no font, no network."""

import re
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

SPACE = '<mspace width="0.167em" />'
NORM = "<mo>&#x02016;</mo>"
FUNCTION = re.compile(r"(<mi>(?:sin|cos|arccos|exp)</mi>)(?=(<mo)?)")


def mathml(formula: str, display: str = "inline") -> str:
    """Convert a formula in LaTeX to MathML.

    The converter leaves out the spaces about functions such as sin; they are added. Bars of norms have one height,
    since browsers stretch each by itself.
    """
    converted = convert(formula, display=display).replace(NORM, NORM.replace("<mo>", '<mo stretchy="false">'))
    return FUNCTION.sub(lambda found: SPACE + found[1] + ("" if found[2] else SPACE), converted)


def _inline(writer: HTML5Translator, node: nodes.math) -> None:
    writer.body.append(mathml(node.astext()))
    raise nodes.SkipNode


def _block(writer: HTML5Translator, node: nodes.math_block) -> None:
    writer.body.append(f'<div class="math">{mathml(node.astext(), "block")}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect the extension to Sphinx."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True}
