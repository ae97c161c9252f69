"""The site's contents, from the links of its first page: each section's pages, hidden, under the section's title.

So the first page reads the same in a repository, where a `toctree` would be a block of file names.
"""

import re
from typing import Any

from sphinx.application import Sphinx

TOCTREE = "```{{toctree}}\n:hidden:\n:caption: {title}\n\n{pages}\n```\n"


def with_contents(page: str) -> str:
    """Add a hidden `toctree` to each section of a Markdown page that links to other pages.

    Entries have the words of the links.
    """
    first, *sections = re.split(r"^## ", page, flags=re.MULTILINE)
    return first + "".join(f"## {section}\n{_toctree(section)}" for section in sections)


def _toctree(section: str) -> str:
    links = re.findall(r"\[([^]]+)\]\(([^)#:]+)\.(?:md|rst|ipynb)\)", section)
    pages = "\n".join(f"{words} <{page}>" for words, page in links)
    return TOCTREE.format(title=section.partition("\n")[0], pages=pages) if links else ""


def _read(app: Sphinx, name: str, source: list[str]) -> None:
    if name == app.config.root_doc:
        source[0] = with_contents(source[0])


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect the extension to Sphinx."""
    app.connect("source-read", _read)
    return {"parallel_read_safe": True}
