"""Bounds of a policy's parameters, far beyond any use: within them every action is a finite number."""

from collections.abc import Mapping


def check(parameters: object, bounds: Mapping[str, tuple[float, float]]) -> None:
    """ValueError for the first attribute that does not lie within its bounds."""
    for name, (low, high) in bounds.items():
        if not low <= (value := getattr(parameters, name)) <= high:  # nan lies nowhere
            raise ValueError(f"{name} must be finite, from {low:g} to {high:g}, not {float(value):g}")
