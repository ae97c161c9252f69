"""Diagrams in Mermaid's language, shown as their source: drawing them takes a script that this site does not carry."""

from typing import Any

from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect the extension to Sphinx."""
    app.add_lexer("mermaid", TextLexer)
    return {"parallel_read_safe": True}
