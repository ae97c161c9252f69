"""Tables of the report page, as texts."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from html import unescape


@dataclass
class PageTable:
    """Table of the page."""

    section: str
    heading: str
    """The last smaller heading of the section above the table; empty without a heading."""
    fold: str
    """The last summary of a collapsible part above the table."""
    rows: list[list[tuple[str, ...]]]
    """Rows of the table; the headings are the first row."""

    @property
    def heads(self) -> list[str]:
        """Return the headings, each with its unit."""
        return [", ".join(cell) for cell in self.rows[0]]


def texts(cell: str) -> tuple[str, ...]:
    """Return the texts of a cell without tags and entities, with plain spaces."""
    parts = re.sub(r'<span class="mark".*?</span>', "", cell).split("<small>")
    return tuple(unescape(re.sub("<.*?>", "", part)).replace("\u00a0", " ").strip() for part in parts)


def page_tables(page: str) -> Iterator[PageTable]:
    for section, body in re.findall(r'<section id="([^"]*)">(.*?)</section>', page, re.DOTALL):
        heading = fold = ""
        pieces = r"<h3>(.*?)</h3>|<summary>(.*?)</summary>|<table.*?>(.*?)</table>"
        for title, summary, table in re.findall(pieces, body, re.DOTALL):
            heading, fold = texts(title)[0] or heading, texts(summary)[0] or fold
            rows = [re.findall(r"<t[hd].*?>(.*?)</t[hd]>", row) for row in re.findall("<tr>(.*?)</tr>", table)]
            if rows:
                yield PageTable(section, heading, fold, [[texts(cell) for cell in row] for row in rows])
