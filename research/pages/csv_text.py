"""Conversion of result tables to CSV text, with one line per row of the table.

Numbers have six significant digits. The cell of an unknown value is empty.
"""

import csv
import io
import math
from collections.abc import Mapping, Sequence
from typing import Any


def to_csv(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """Format the rows of a table as the content of a CSV file in UTF-8.

    Args:
        rows: Rows of the table: name of the column -> value. A row may lack columns, which stay empty.

    Returns:
        Content of the file, with the columns in the order in which they first appear in the rows.
    """
    columns = list(dict.fromkeys(name for row in rows for name in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: _cell(value) for name, value in row.items()} for row in rows)
    return text.getvalue().encode()


def flatten_entry(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Convert a nested dictionary of results to the row of a table.

    Args:
        entry: Results of one policy or comparison, as in results.json: name -> value. A confidence interval `x_ci` is a
            list of two numbers.

    Returns:
        Name of the column -> value. An interval `x_ci` becomes two columns, `x_low` and `x_high`. Other lists and
        dictionaries are left out.
    """
    row: dict[str, Any] = {}
    for name, value in entry.items():
        if name == "ci" or name.endswith("_ci"):
            stem = name.removesuffix("ci")
            row |= dict(zip((f"{stem}low", f"{stem}high"), value, strict=True))
        elif not isinstance(value, dict | list):
            row[name] = value
    return row


def _cell(value: Any) -> Any:
    """Format the value of a cell for CSV: a float has six significant digits, None and NaN are empty."""
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.6g}"
    return "" if value is None else value
