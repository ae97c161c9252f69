"""Functions that create elements of an HTML page: tables, images, collapsible parts.

The functions escape arguments named `text` and values of HTML attributes. All other arguments must be valid HTML.
"""

import base64
import re
from collections.abc import Iterable, Mapping
from html import escape


def section(title: str, *parts: str, anchor: str = "") -> str:
    """Create a section of the page; the result is empty if all parts are empty.

    Args:
        title: Heading of the section, HTML.
        *parts: Contents of the section, HTML.
        anchor: Identifier for links; if it is empty, it is made from the words of the title.

    Returns:
        HTML of the section.
    """
    body = "".join(parts)
    identity = anchor or re.sub(r"\W+", "-", re.sub(r"<.*?>", "", title)).strip("-").lower()
    return f'<section id="{escape(identity)}"><h2>{title}</h2>{body}</section>\n' if body else ""


def contents(sections: str, label: str = "Contents") -> str:
    """Create a navigation bar with links to all sections in the HTML of a page.

    Args:
        sections: HTML of all sections of the page.
        label: Name of the navigation bar for screen readers.

    Returns:
        HTML of the navigation bar.
    """
    anchors = re.findall(r'<section id="([^"]*)"><h2>(.*?)(?: <small>.*?)?</h2>', sections)
    links = "".join(f'<li><a href="#{identity}">{title}</a></li>' for identity, title in anchors)
    return f'<nav aria-label="{label}"><ul>{links}</ul></nav>\n'


def collapsible(summary: str, body: str, *, printed: bool = False) -> str:
    """Create a part of the page that opens on a click; the result is empty if the body is empty.

    Args:
        summary: Line that is always visible, HTML.
        body: Contents that become visible on a click, HTML.
        printed: True if the contents appear on paper even while the part is closed.

    Returns:
        HTML of the part.
    """
    state = ' class="printed"' if printed else ""
    return f"<details{state}><summary>{summary}</summary>{body}</details>" if body else ""


def note(text: str) -> str:
    """Create a paragraph of text in small grey type."""
    return f'<p class="note">{escape(text)}</p>'


def table(heads: Mapping[str, str], rows: Iterable[Mapping[str, str]], kind: str = "") -> str:
    """Create a table that scrolls within itself if the page is too narrow.

    Args:
        heads: Name of a column -> its heading, HTML.
        rows: Rows; a row is a dictionary: name of a column -> contents of the cell, HTML.
        kind: CSS class of the table; empty if it has none.

    Returns:
        HTML of the table.
    """
    head = "".join(f"<th>{text}</th>" for text in heads.values())
    body = "".join(_table_row(heads, row) for row in rows)
    style = f' class="{kind}"' if kind else ""
    return wide(f"<table{style}><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>")


def _table_row(columns: Iterable[str], row: Mapping[str, str]) -> str:
    cells = "".join(f"<td>{row[column]}</td>" for column in columns)
    return f"<tr>{cells}</tr>"


def wide(body: str) -> str:
    """Create an element with the HTML `body` that scrolls within itself if the page is too narrow."""
    return f'<div class="wide">{body}</div>'


def heading(name: str, unit: str) -> str:
    """Create the heading of a table column: the `name` of a quantity, with its `unit` below."""
    return f"{name}<small>{unit}</small>" if unit else name


def breakable(text: str) -> str:
    """Escape a `text` for HTML, and allow line breaks after the words of long names, for narrow screens."""
    return re.sub(r"(?<=[^\W_][/_:@+-])(?=[^\W_])", "<wbr>", escape(text))


def mark(colour: str, glyph: str) -> str:
    """Create the mark of a policy or a cause of failure: the character `glyph` in the given `colour`."""
    return f'<span class="mark" style="color:{colour}">{glyph}</span>'


def image(svg: bytes, description: str) -> str:
    """Embed an `svg` image with its `description` for screen readers."""
    return f'<img alt="{escape(description)}" src="data:image/svg+xml;base64,{base64.b64encode(svg).decode()}">'


def grid(images: Iterable[str]) -> str:
    """Arrange `images`, or other HTML elements, in two columns, or in one column on a phone."""
    return f'<div class="plots">{"".join(images)}</div>'
