"""Arrays that a controller remembers from step to step, one row a robot."""

import numpy as np
from numpy.typing import NDArray

from policies.gait import Floats


class Memory:
    """Named arrays (n, …), each started from a value that is the same for every robot."""

    def __init__(self, start: dict[str, Floats]) -> None:
        self._start = start
        self.allocate(1)

    def allocate(self, num_envs: int) -> None:
        """Fresh rows for `num_envs` robots."""
        self._now = {name: np.tile(value, (num_envs, 1)) for name, value in self._start.items()}

    def restart(self, mask: NDArray[np.bool_]) -> None:
        """Fresh rows for the robots where the mask (n,) is true."""
        self._now = {name: np.where(mask[:, None], self._start[name], value) for name, value in self._now.items()}

    def __getitem__(self, name: str) -> Floats:
        return self._now[name]

    def __setitem__(self, name: str, value: Floats) -> None:
        self._now[name] = value
