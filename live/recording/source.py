"""What the process that writes a recording is told of the steps that it is sent."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Source:
    """What the recorded steps are of."""

    names: tuple[str, ...]
    """Of the columns of a batch, after the number of the control step and before the correction."""
    joints: tuple[str, ...]
    legs: tuple[str, ...]
    dt: float
    """Control period, s."""
