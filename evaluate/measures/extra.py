"""Measures (numbers per episode) that other packages define and register in an `Extension`.

Each measure becomes a column of episodes.parquet, the table of the evaluated episodes.
"""

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
    """Measure (number per episode) that another package defines, and registers in a `quad_env.Extension`."""

    function: Callable[[Episodes], Any]
    """Function that receives n recorded episodes and returns the measure of each, (n,); NaN if it is undefined."""
    title: str
    """Title of the measure in tables."""
    unit: str = ""
    """Unit of the measure; empty for a fraction or a pure number."""
    frame: str = ""
    """Coordinate frame of the measure, for example `heading`; empty if the measure has no frame."""
    formula: str = ""
    """Definition of the measure in words or as a formula, as shown in the report."""
    scope: Scope = WHOLE
    """Control steps that enter the measure: the whole episode, or only the steps before a fall."""


def extra_measures() -> dict[str, ExtraMeasure]:
    """Return all measures that extensions have registered in this process.

    Returns:
        Name of the measure -> definition.

    Raises:
        ValueError: An object is not an `ExtraMeasure`, or its name is already a column of episodes.parquet.
    """
    measures = check_new("measures", dict.fromkeys((*BY_NAME, *COLUMNS)))
    for name, measure in measures.items():
        if not isinstance(measure, ExtraMeasure):
            raise ValueError(f"extension: measures {name}: expected an ExtraMeasure, got {measure!r}")
    return measures


COLUMNS = ("policy", "scenario", "severity", "episode", "seed", "fall_reason", "failure")
"""Names of the columns of episodes.parquet that identify an episode and are not measures."""


def compute_extra(episodes: Episodes) -> dict[str, Floats]:
    """Compute all measures that extensions have registered, for recorded episodes.

    Args:
        episodes: n recorded episodes.

    Returns:
        Name of the measure -> value of each episode, (n,).

    Raises:
        ValueError: The function of a measure returned an array with another shape than (n,).
    """
    values: dict[str, Floats] = {}
    for name, measure in extra_measures().items():
        value = np.asarray(measure.function(episodes), dtype=np.float64)
        if value.shape != (episodes.count,):
            raise ValueError(f"extension: measures {name}: expected the shape ({episodes.count},), got {value.shape}")
        values[name] = value
    return values


def definition(name: str) -> Measure:
    """Return the definition of the measure `name`, which this project or an extension has defined.

    If the extension is not installed, the definition has no unit, frame or formula.
    """
    if name in BY_NAME:
        return BY_NAME[name]
    measure = extra_measures().get(name)
    if measure is None:
        return Measure(name, name.replace("_", " "), "", "", "of an extension that is not installed here", "extension")
    return Measure(name, measure.title, measure.unit, measure.frame, measure.formula, "extension", measure.scope)
