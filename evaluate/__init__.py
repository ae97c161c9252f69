"""Evaluator: simulates policies in equal episodes, and writes their ranking, statistics and a report.

`evaluate.load(FOLDER)` reads a results folder as tables. Its modules are imported when it is first used, so that
commands start fast.
"""

from typing import TYPE_CHECKING, Any

from evaluate.distribution import check_distribution

if TYPE_CHECKING:
    from evaluate.analysis.tables import RunTables, load

__all__ = ["RunTables", "load"]
check_distribution()


def __getattr__(name: str) -> Any:
    """Import a public name of this package when it is first used."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from evaluate.analysis import tables

    return getattr(tables, name)
