"""Scenarios for the training of policies with a height scan: uneven ground, and scans that are lost."""

import dataclasses
from collections.abc import Sequence
from typing import Any

from quad_env.scenarios.scenario import HARDWARE, SCAN_DROPOUTS, SCAN_LOST
from train.config import TrainConfig

Mixture = tuple[tuple[str, float], ...]
"""Type of the scenarios of a training: name and share of each."""
IMPROVE_TERRAINS: Mixture = (
    ("rough:3", 0.05), ("rough:4", 0.10), ("rough:5", 0.03), ("stairs:2", 0.05), ("stairs:3", 0.12), ("stairs:4", 0.05),
    ("gravel:3", 0.03), ("gravel:4", 0.05), ("rough:4+hardware", 0.03), ("stairs:3+hardware", 0.03),
    ("rough:4+scan_lost", 0.03), ("stairs:3+scan_lost", 0.03),
)  # fmt: skip
"""Uneven ground in the recipe `improve` of a policy with a height scan, each with the fraction of the robots on it."""
IMPROVE_FRACTION = 0.4
"""Fraction of the robots of a policy with a height scan on the other scenarios of the recipe, with scan dropouts."""
IMPROVE_VALIDATION = ("rough:4", f"rough:4{SCAN_LOST}")
"""Further validation scenarios of the recipe `improve` of a policy with a height scan."""


def with_scan_dropouts(mixture: Sequence[tuple[str, float]], fraction: float) -> Mixture:
    """Return the scenarios of a mixture with dropouts of the height scan.

    Args:
        mixture: Name and share of each scenario; a name may end with the suffix of the hardware profile.
        fraction: Factor on the shares.

    Returns:
        Name and share of each scenario.
    """
    suffixes = [HARDWARE if name.endswith(HARDWARE) else "" for name, _ in mixture]
    return tuple(
        (f"{name.removesuffix(suffix)}{SCAN_DROPOUTS}{suffix}", fraction * share)
        for (name, share), suffix in zip(mixture, suffixes, strict=True)
    )


def improve_settings(defaults: TrainConfig) -> dict[str, Any]:
    """Return the settings of the recipe `improve` that differ if the policy of --start has a height scan.

    Args:
        defaults: Default settings of the recipe.

    Returns:
        Name of the setting -> value; empty for another recipe.
    """
    if defaults.recipe != "improve":
        return {}
    scenarios = (*defaults.validation.scenarios, *IMPROVE_VALIDATION)
    return {
        "mixture": (*IMPROVE_TERRAINS, *with_scan_dropouts(defaults.mixture, IMPROVE_FRACTION)),
        "validation": dataclasses.replace(defaults.validation, scenarios=scenarios),
    }
