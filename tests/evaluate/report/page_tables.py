"""The tables of a report as a reader finds them: headings, cells, and what stands above."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from html.parser import HTMLParser


@dataclass
class PageTable:
    """A table of the page. The texts of a cell are its figure and the lines below it; spaces are plain ones."""

    section: str
    """Anchor of the section that it is in."""
    heading: str
    """The last smaller heading above it in the section; empty without one."""
    fold: str
    """The last summary of a fold above it."""
    rows: list[list[tuple[str, ...]]] = field(default_factory=list)
    """The headings first."""

    @property
    def heads(self) -> list[str]:
        """Headings, each with its unit."""
        return [", ".join(cell) for cell in self.rows[0]]

    def by_heading(self) -> Iterator[dict[str, tuple[str, ...]]]:
        """Every row: heading -> texts of the cell."""
        for row in self.rows[1:]:
            yield dict(zip(self.heads, row, strict=True))


class _Parser(HTMLParser):
    """Collects the tables of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.tables: list[PageTable] = []
        self._section = self._heading = self._fold = ""
        self._texts: list[str] | None = None
        """Of what is being read: a cell's figure and lines, or a heading's words."""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        about = dict(attrs)
        if tag == "section":
            self._section, self._heading, self._fold = about.get("id") or "", "", ""
        elif tag == "table":
            self.tables.append(PageTable(self._section, self._heading, self._fold))
        elif tag == "tr":
            self.tables[-1].rows.append([])
        elif tag in ("th", "td", "h3", "summary") or (tag == "span" and "mark" in (about.get("class") or "")):
            self._texts = [""]
        elif tag == "small" and self._texts is not None:
            self._texts.append("")

    def handle_endtag(self, tag: str) -> None:
        if tag in ("th", "td"):
            self.tables[-1].rows[-1].append(tuple(map(_plain, self._texts or ())))
        elif tag == "h3":
            self._heading = _plain((self._texts or [""])[0])
        elif tag == "summary":
            self._fold = _plain((self._texts or [""])[0])
        elif tag == "span" and self._texts is not None:  # a policy's mark is no part of its name
            self._texts = [""]
            return
        if tag in ("th", "td", "h3", "summary"):
            self._texts = None

    def handle_data(self, data: str) -> None:
        if self._texts is not None:
            self._texts[-1] += data


def _plain(text: str) -> str:
    return text.replace("\u00a0", " ").strip()


def page_tables(page: str) -> list[PageTable]:
    """Every table of an HTML page."""
    parser = _Parser()
    parser.feed(page)
    return parser.tables


def markdown_tables(page: str) -> list[PageTable]:
    """Every table of a Markdown page."""
    tables: list[PageTable] = []
    fold, inside = "", False
    for line in page.splitlines():
        if line.startswith("<details>"):
            fold = line.removeprefix("<details><summary>").removesuffix("</summary>")
        if line.startswith("|") and not inside:
            tables.append(PageTable("", "", fold))
        inside = line.startswith("|")
        if inside and not line.startswith("|--"):
            tables[-1].rows.append([(_plain(cell).strip("`"),) for cell in line.strip("|").split(" | ")])
    return tables
