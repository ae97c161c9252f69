"""Docstrings as this project writes them: Google's sections, and what is indented is code or a formula as it stands."""

from collections.abc import Iterator, Sequence
from typing import Any

from sphinx.application import Sphinx
from sphinx.ext.napoleon import Config
from sphinx.ext.napoleon.docstring import GoogleDocstring

SETTINGS: Any = Config()


def with_literal_blocks(lines: Sequence[str]) -> Iterator[str]:
    """Yield the lines with `::` before each indented block that follows an empty line."""
    before = ""  # the last line that is not empty
    for number, line in enumerate(lines):
        if line.startswith("    ") and number and not lines[number - 1] and not before.startswith(" "):
            yield from ("::", "")
        before = line or before
        yield line


def _process(app: Sphinx, what: Any, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    if what not in ("attribute", "data", "property"):  # there Napoleon takes what stands before a colon for a type
        lines[:] = GoogleDocstring(list(with_literal_blocks(lines)), SETTINGS, app, what, name, thing, options).lines()


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect the extension to Sphinx."""
    app.connect("autodoc-process-docstring", _process)
    return {"parallel_read_safe": True}
