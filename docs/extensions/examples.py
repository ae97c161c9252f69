"""The files in `examples/`, on the page that is about them: what each is, and its lines."""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

PLACE = "<!-- examples -->"
"""Where they go on the page."""
ENTRY = "## {name}\n\n{about}\n\n```{{literalinclude}} ../{name}\n:language: python\n```\n"


def entries(repository: Path) -> Iterator[str]:
    """Markdown of each example, in the order of their names."""
    for path in sorted((repository / "examples").rglob("*.py")):
        if not path.name.startswith("_"):
            about = (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").partition("\n\n")[0]
            yield ENTRY.format(name=path.relative_to(repository).as_posix(), about=about)


def _read(app: Sphinx, name: str, source: list[str]) -> None:
    if PLACE in source[0]:
        source[0] = source[0].replace(PLACE, "\n".join(entries(Path(app.srcdir))))


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect the extension to Sphinx."""
    app.connect("source-read", _read)
    return {"parallel_read_safe": True}
