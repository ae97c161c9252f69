"""Arrays that a controller remembers from step to step, robots along the last axis."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from policies.gait_cycle import Floats


def taken_in(control_period: float, time_constant: float) -> float:
    """Share of a change that a first-order filter of that time constant takes in within a control period, both s."""
    return control_period / (control_period + time_constant)


def at_first_a_mean(share: float | Floats, looks: NDArray[Any]) -> Floats:
    """Share that such a filter takes in at its k-th look, counted in `looks`, where until there are many it is their
    mean: at least 1 / k."""
    larger: Floats = np.maximum(share, 1.0 / np.maximum(looks, 1))
    return larger


class Memory:
    """Named arrays (…, n), each started from a value (…) that is the same for every robot."""

    def __init__(self, **start: ArrayLike) -> None:
        self._start = {name: np.asarray(value)[..., None] for name, value in start.items()}
        self.allocate(1)

    def allocate(self, num_envs: int) -> None:
        """Fresh columns for `num_envs` robots."""
        self._now = {name: np.repeat(value, num_envs, axis=-1) for name, value in self._start.items()}

    def restart(self, mask: NDArray[np.bool_]) -> None:
        """Fresh columns for the robots where the mask (n,) is true."""
        self._now = {name: np.where(mask, self._start[name], value) for name, value in self._now.items()}

    def __getitem__(self, name: str) -> Floats:
        return self._now[name]

    def __setitem__(self, name: str, value: Floats) -> None:
        self._now[name] = value
