"""Extension measures: defined by other packages, each is one column of `episodes.parquet`."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from evaluate.measures.averages import Floats
from evaluate.measures.catalogue import BY_NAME, WHOLE, Measure, Scope
from evaluate.measures.episodes import Episodes
from quad_env.extensions import check_new


@dataclass(frozen=True)
class ExtraMeasure:
    """Measure that another package defines and registers by name in a `quad_env.Extension`."""

    function: Callable[[Episodes], Any]
    """Function that returns one value for each of n recorded episodes, (n,); NaN means no value."""
    title: str
    """Name of the measure in tables."""
    unit: str = ""
    """Unit; empty for a fraction or a pure number."""
    frame: str = ""
    """Frame of the quantity; empty if the quantity has no frame."""
    formula: str = ""
    """Definition, as shown in the report."""
    scope: Scope = WHOLE
    """Control steps that enter the measure."""


def extra_measures() -> dict[str, ExtraMeasure]:
    """Return the extension measures of this process.

    Returns:
        Name -> measure.

    Raises:
        ValueError: An entry is not an `ExtraMeasure`, or its name is already a column of the project.
    """
    measures = check_new("measures", dict.fromkeys((*BY_NAME, *COLUMNS)))
    for name, measure in measures.items():
        if not isinstance(measure, ExtraMeasure):
            raise ValueError(f"extension: measures {name}: expected an ExtraMeasure, got {measure!r}")
    return measures


COLUMNS = ("policy", "scenario", "severity", "episode", "seed", "fall_reason", "failure")
"""Columns of `episodes.parquet` that are not measures."""


def compute_extra(episodes: Episodes) -> dict[str, Floats]:
    """Compute all extension measures of recorded episodes.

    Args:
        episodes: n recorded episodes.

    Returns:
        Name -> measure, (n,).

    Raises:
        ValueError: The function of a measure returned an array of a shape other than (n,).
    """
    values: dict[str, Floats] = {}
    for name, measure in extra_measures().items():
        value = np.asarray(measure.function(episodes), dtype=np.float64)
        if value.shape != (episodes.count,):
            raise ValueError(f"extension: measures {name}: expected the shape ({episodes.count},), got {value.shape}")
        values[name] = value
    return values


def definition(name: str) -> Measure:
    """Return the definition of the measure `name`.

    The definition has no unit, frame or formula if the extension of the measure is not installed.
    """
    if name in BY_NAME:
        return BY_NAME[name]
    measure = extra_measures().get(name)
    if measure is None:
        return Measure(name, name.replace("_", " "), "", "", "of an extension that is not installed here", "extension")
    return Measure(name, measure.title, measure.unit, measure.frame, measure.formula, "extension", measure.scope)
