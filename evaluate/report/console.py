"""Tables on a terminal: in columns, or where it is too narrow for them, in lines."""

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
"""Characters of a name in a line at the head of a row; the rest goes on below."""
_BREAK = "\u200b\n"
"""Line break in a name; a table drops the first character."""
UNBOUNDED = 10_000
"""Columns that no table needs."""


def row_name(name: str) -> str:
    """A name at the head of a row, as markup."""
    return f" {escape(name_in_lines(name, NAME_WIDTH, ' '))}"


def name_in_lines(name: str, width: int, indent: str = "") -> str:
    """Break a name at the ends of its words; it is whole again in lines instead of a table.

    Args:
        name: Name.
        width: Characters of a line.
        indent: Text before each further line.
    """
    return f"{_BREAK}{indent}".join(break_name(name, width))


def breaking_names(text: str, width: int) -> str:
    """Break words longer than a line, such as paths, at the ends of their parts."""
    return re.sub(r"\S+", lambda word: "\n".join(break_name(word[0], width)) if len(word[0]) > width else word[0], text)


@dataclass(frozen=True)
class FittedTable:
    """A table in the style of all of them, or, where the console is too narrow for it, the same in lines."""

    title: str
    heads: Mapping[str, str]
    groups: Mapping[str, Sequence[Mapping[str, str]]]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        table = self._table()
        wide = options.update(max_width=UNBOUNDED)
        yield table if Measurement.get(console, wide, table).maximum <= options.max_width else Group(*self._lines())

    def _table(self) -> Table:
        table = Table(
            title=self.title, title_justify="left", title_style="", box=SIMPLE_HEAD, padding=(0, 1, 0, 0),
            show_edge=False,
        )  # fmt: skip
        first = next(iter(self.heads))
        for column, head in self.heads.items():
            table.add_column(_in_a_table(head), justify="left" if column == first else "right", overflow="fold")
        for group, rows in self.groups.items():
            if group:
                table.add_row(f"[bold]{escape(group)}[/bold]")
            for row in rows:
                table.add_row(*(_in_a_table(row[column]) for column in self.heads))
        return table

    def _lines(self) -> Iterator[RenderableType]:
        (first, *columns), heads = self.heads, {name: _in_a_line(head) for name, head in self.heads.items()}
        yield self.title
        for group, rows in self.groups.items():
            if group:
                yield f"[bold]{escape(group)}[/bold]"
            for row in rows:
                yield _in_a_line(row[first]).removeprefix(" ")
                cells = (f"{heads[name]}: {_in_a_line(row[name], NO_BREAK)}" for name in columns if row[name])
                yield Padding("; ".join(cells), (0, 0, 0, 2))


def _in_a_table(text: str) -> str:
    return text.replace(_BREAK, "\n")


def _in_a_line(text: str, space: str = " ") -> str:
    """A cell that was broken, as one line; a name goes on where it was broken."""
    return re.sub(f"{_BREAK} ?", "", text).replace("\n", " ").replace(" ", space)


def console_table(
    title: str, heads: Mapping[str, str], groups: Mapping[str, Iterable[Mapping[str, str]]]
) -> FittedTable:
    """A table: headings, and the cells of each row, by column, below their group's name."""
    return FittedTable(title, heads, {group: [*rows] for group, rows in groups.items()})
