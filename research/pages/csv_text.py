"""Tables as CSV: one line per row.

Numbers have six significant digits. The cells of unknown values are empty.
"""

import csv
import io
import math
from collections.abc import Mapping, Sequence
from typing import Any


def to_csv(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """Format `rows` as a CSV file in UTF-8.

    The columns are the keys of all rows, in the order of first use.
    """
    columns = list(dict.fromkeys(name for row in rows for name in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: _cell(value) for name, value in row.items()} for row in rows)
    return text.getvalue().encode()


def flatten_entry(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Flatten an entry of a results.json to a row: name of the column -> value.

    An interval `x_ci` becomes two columns, `x_low` and `x_high`. Other lists and dictionaries are left out.
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
    """Format a value for CSV: floats with six significant digits, and None and NaN as an empty cell."""
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.6g}"
    return "" if value is None else value
