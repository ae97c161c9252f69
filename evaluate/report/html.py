"""Pieces of HTML: tables, images, folds. Every argument called text is escaped here, every other is ready HTML."""

import base64
import re
from collections.abc import Iterable, Mapping
from html import escape


def section(title: str, *parts: str, anchor: str = "") -> str:
    """A section of the page, which `contents` finds by its anchor or its title's words; empty without parts."""
    body = "".join(parts)
    identity = anchor or re.sub(r"\W+", "-", re.sub(r"<.*?>", "", title)).strip("-").lower()
    return f'<section id="{escape(identity)}"><h2>{title}</h2>{body}</section>\n' if body else ""


def contents(sections: str, label: str = "Contents") -> str:
    """Ways to all the sections."""
    found = re.findall(r'<section id="([^"]*)"><h2>(.*?)(?: <small>.*?)?</h2>', sections)
    links = "".join(f'<li><a href="#{identity}">{title}</a></li>' for identity, title in found)
    return f'<nav aria-label="{label}"><ul>{links}</ul></nav>\n'


def fold(summary: str, body: str, *, printed: bool = False) -> str:
    """Something that opens on a click; on paper only if it is open or `printed`; empty without a body."""
    state = ' class="printed"' if printed else ""
    return f"<details{state}><summary>{summary}</summary>{body}</details>" if body else ""


def note(text: str) -> str:
    """A line in small soft type."""
    return f'<p class="note">{escape(text)}</p>'


def table(heads: Mapping[str, str], rows: Iterable[Mapping[str, str]], kind: str = "") -> str:
    """A table that scrolls within itself where a phone is too narrow: headings, and cells of each row, by column."""
    head = "".join(f"<th>{text}</th>" for text in heads.values())
    body = "".join(f"<tr>{''.join(f'<td>{row[column]}</td>' for column in heads)}</tr>" for row in rows)
    named = f' class="{kind}"' if kind else ""
    return wide(f"<table{named}><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>")


def wide(body: str) -> str:
    """What scrolls within itself where the page is narrower."""
    return f'<div class="wide">{body}</div>'


def heading(name: str, unit: str) -> str:
    """A column's name with its unit below."""
    return f"{name}<small>{unit}</small>" if unit else name


def breakable(text: str) -> str:
    """A text whose names may break at the ends of their words where a phone needs it to."""
    return re.sub(r"(?<=[^\W_][/_:@+-])(?=[^\W_])", "<wbr>", escape(text))


def mark(colour: str, glyph: str) -> str:
    """A policy's mark in its colour."""
    return f'<span class="mark" style="color:{colour}">{glyph}</span>'


def image(svg: bytes, description: str) -> str:
    """An image that travels within the page."""
    return f'<img alt="{escape(description)}" src="data:image/svg+xml;base64,{base64.b64encode(svg).decode()}">'


def grid(images: Iterable[str]) -> str:
    """Images, or other parts, in two columns; on a phone one below the other."""
    return f'<div class="plots">{"".join(images)}</div>'
