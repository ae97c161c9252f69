"""Tables for a terminal: printed in columns, or as lines of text if the terminal is too narrow."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from rich.box import SIMPLE_HEAD
from rich.console import Console, ConsoleOptions, Group, RenderableType
from rich.markup import escape
from rich.measure import Measurement
from rich.padding import Padding
from rich.table import Table

from quad_env.cli.format import NO_BREAK, break_name

NAME_WIDTH = 20
"""Maximum width of a line of the names in the first column of a table, characters."""
_BREAK = "\u200b\n"
"""Mark for a line break inside a long name: a zero-width space and a newline.

The zero-width space distinguishes this line break from others. A table with columns replaces the mark by a line break.
A table that is printed as lines of text removes the mark, which joins the parts of the name.
"""
UNLIMITED_WIDTH = 10_000
"""Width that is larger than every table, characters; with it, the natural width of a table is measured."""


def format_row_name(name: str) -> str:
    """Format the `name` of a row for the first column of a table, as markup of the library rich."""
    return f" {escape(wrap_name(name, NAME_WIDTH, ' '))}"


def wrap_name(name: str, width: int, indent: str = "") -> str:
    """Break a name into lines at the ends of its words.

    Args:
        name: Name to break.
        width: Largest number of characters in a line.
        indent: Text at the start of the second and every further line.

    Returns:
        The name with marked line breaks, which `FittedTable` removes if it prints lines instead of columns.
    """
    return f"{_BREAK}{indent}".join(break_name(name, width))


def break_long_words(text: str, width: int) -> str:
    """Break every word of a `text` with more than `width` characters into lines, at its separators."""

    def break_word(match: re.Match[str]) -> str:
        word = match[0]
        return "\n".join(break_name(word, width)) if len(word) > width else word

    return re.sub(r"\S+", break_word, text)


@dataclass(frozen=True)
class FittedTable:
    """Table for the terminal; if the terminal is too narrow, the cells are printed as lines of text."""

    title: str
    """Text above the table."""
    heads: Mapping[str, str]
    """Name of a column -> its heading; the first column is left-aligned."""
    groups: Mapping[str, Sequence[Mapping[str, str]]]
    """Name of a group of rows -> its rows; a row is a dictionary: name of a column -> text of the cell.

    If the name of the group is not empty, it is printed above the rows.
    """

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        table = self._table()
        wide = options.update(max_width=UNLIMITED_WIDTH)
        yield table if Measurement.get(console, wide, table).maximum <= options.max_width else Group(*self._lines())

    def _table(self) -> Table:
        table = Table(
            title=self.title, title_justify="left", title_style="", box=SIMPLE_HEAD, padding=(0, 1, 0, 0),
            show_edge=False,
        )  # fmt: skip
        first = next(iter(self.heads))
        for column, head in self.heads.items():
            table.add_column(_table_text(head), justify="left" if column == first else "right", overflow="fold")
        for group, rows in self.groups.items():
            if group:
                table.add_row(f"[bold]{escape(group)}[/bold]")
            for row in rows:
                table.add_row(*(_table_text(row[column]) for column in self.heads))
        return table

    def _lines(self) -> Iterator[RenderableType]:
        first, *columns = self.heads
        heads = {name: _line_text(head) for name, head in self.heads.items()}
        yield self.title
        for group, rows in self.groups.items():
            if group:
                yield f"[bold]{escape(group)}[/bold]"
            for row in rows:
                yield _line_text(row[first]).removeprefix(" ")
                cells = (f"{heads[name]}: {_line_text(row[name], NO_BREAK)}" for name in columns if row[name])
                yield Padding("; ".join(cells), (0, 0, 0, 2))


def _table_text(text: str) -> str:
    return text.replace(_BREAK, "\n")


def _line_text(text: str, space: str = " ") -> str:
    """Join the lines of a cell with `space`; the parts of a broken name are joined without a space."""
    return re.sub(f"{_BREAK} ?", "", text).replace("\n", " ").replace(" ", space)


def console_table(
    title: str, heads: Mapping[str, str], groups: Mapping[str, Iterable[Mapping[str, str]]]
) -> FittedTable:
    """Create a table from headings and grouped rows.

    Args:
        title: Text above the table.
        heads: Name of a column -> its heading.
        groups: Name of a group of rows -> its rows; a row is a dictionary: name of a column -> text of the cell.

    Returns:
        A table that the library rich can print.
    """
    return FittedTable(title, heads, {group: [*rows] for group, rows in groups.items()})
