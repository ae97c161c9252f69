"""Measures of other packages, computed from recorded signals: one column of `episodes.parquet` each."""

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
    """A measure of another package; its author makes it, `quad_env.Extension` holds it by name."""

    function: Callable[[Episodes], Any]
    """Value of each of n recorded episodes, (n,); NaN if an episode has none."""
    title: str
    """Words for tables."""
    unit: str = ""
    """Unit; empty for a fraction or a pure number."""
    frame: str = ""
    """Frame of the quantity; empty without one."""
    formula: str = ""
    """Definition, as shown in the report."""
    scope: Scope = WHOLE
    """Steps that count."""


def extra_measures() -> dict[str, ExtraMeasure]:
    """Return the measures of extensions by name.

    Returns:
        Name -> measure.

    Raises:
        ValueError: An entry is no `ExtraMeasure`, or has the name of a column of the project.
    """
    measures = check_new("measures", dict.fromkeys((*BY_NAME, *COLUMNS)))
    for name, measure in measures.items():
        if not isinstance(measure, ExtraMeasure):
            raise ValueError(f"extension: measures {name}: expected an ExtraMeasure, got {measure!r}")
    return measures


COLUMNS = ("policy", "scenario", "severity", "episode", "seed", "fall_reason", "failure")
"""Columns of `episodes.parquet` that are no measures."""


def compute_extra(episodes: Episodes) -> dict[str, Floats]:
    """Compute the measures of extensions.

    Args:
        episodes: n recorded episodes.

    Returns:
        Name -> measure, (n,).

    Raises:
        ValueError: A function returned another shape.
    """
    values: dict[str, Floats] = {}
    for name, measure in extra_measures().items():
        value = np.asarray(measure.function(episodes), dtype=np.float64)
        if value.shape != (episodes.count,):
            raise ValueError(f"extension: measures {name}: expected the shape ({episodes.count},), got {value.shape}")
        values[name] = value
    return values


def definition(name: str) -> Measure:
    """Return the definition of the measure `name`; of an extension that is not installed, its bare name."""
    if name in BY_NAME:
        return BY_NAME[name]
    measure = extra_measures().get(name)
    if measure is None:
        return Measure(name, name.replace("_", " "), "", "", "of an extension that is not installed here", "extension")
    return Measure(name, measure.title, measure.unit, measure.frame, measure.formula, "extension", measure.scope)
