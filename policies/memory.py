"""What a controller remembers of each of n robots from one control step to the next, and filters of it."""

from collections import defaultdict
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray


class PerRobotArray:
    """An array of robots along an axis, each of which starts with a value, or with what a function of the object gives.

    Read before the first `reset` of its object, it has one robot.
    """

    def __init__(self, start: Any, axis: int) -> None:
        self._start, self.axis = start, axis

    def __set_name__(self, kind: type, name: str) -> None:
        self.name = name
        _FIELDS[kind].append(self)

    def __get__(self, owner: Any, kind: type) -> Any:
        if owner is None:
            return self
        owner.reset(1)
        return vars(owner)[self.name]

    def initial_value(self, owner: Any) -> NDArray[Any]:
        """The array of one robot at its start."""
        return np.expand_dims(self._start(owner) if callable(self._start) else self._start, self.axis)


_FIELDS = defaultdict[type, list[PerRobotArray]](list)
"""By the class that has them."""


def per_robot(start: Any, axis: int = 0) -> Any:
    """A field of a class that has `reset`, see `Field`; `start` gives the array's type and the rest of its shape."""
    return PerRobotArray(start, axis)


class PerRobotState:
    """What has fields `per_robot`; its attributes that are such, and those in its dictionaries, begin with it."""

    def reset(self, num_envs: int) -> None:
        """Fresh memory of so many robots."""
        allocate(self, num_envs)

    def reset_where(self, mask: NDArray[np.bool_]) -> None:
        """Fresh memory of the robots where the mask, (n,), is true."""
        reset_rows(self, mask)

    def copy_state_from(self, mask: NDArray[np.bool_], other: Any) -> None:
        """Go on where the mask, (n,), is true with the robots of another one of the same kind, as many as these."""
        take_over(self, mask, other)


def allocate(owner: Any, num_envs: int) -> None:
    """Fresh fields of an object for so many robots."""
    for field in _fields(owner):
        setattr(owner, field.name, np.repeat(field.initial_value(owner), num_envs, field.axis))
    for part in _children(owner):
        part.reset(num_envs)


def reset_rows(owner: Any, mask: NDArray[np.bool_]) -> None:
    """Fresh fields of an object for the robots where the mask, (n,), is true; arrays handed out stay what they were."""
    for field in _fields(owner):
        _put(owner, field, mask, field.initial_value(owner))
    for part in _children(owner):
        part.reset_where(mask)


def take_over(owner: Any, mask: NDArray[np.bool_], other: Any) -> None:
    """Put the fields of another object of the same kind where the mask, (n,), is true, as many robots as it has."""
    for field in _fields(owner):
        _put(owner, field, mask, getattr(other, field.name))
    for part, theirs in zip(_children(owner), _children(other), strict=True):
        part.copy_state_from(mask, theirs)


def _put(owner: Any, field: PerRobotArray, mask: NDArray[np.bool_], values: NDArray[Any]) -> None:
    now = getattr(owner, field.name).copy()
    now[(*[slice(None)] * field.axis, mask)] = values
    setattr(owner, field.name, now)


def _fields(owner: Any) -> list[PerRobotArray]:
    return [field for kind in reversed(type(owner).__mro__) for field in _FIELDS.get(kind, ())]


def _children(owner: Any) -> Iterator[PerRobotState]:
    for value in vars(owner).values():
        for each in value.values() if isinstance(value, dict) else (value,):
            if isinstance(each, PerRobotState):
                yield each


def lowpass_gain(control_period: float, time_constant: float) -> float:
    """Share of a change that a first-order filter of that time constant takes in within a control period, both s."""
    return control_period / (control_period + time_constant)


def warm_start_gain(share: float | NDArray[np.float64], sample_count: NDArray[Any]) -> NDArray[np.float64]:
    """Share that such a filter takes in at its k-th look, counted in `looks`, where until there are many it is their
    mean: at least 1 / k."""
    larger: NDArray[np.float64] = np.maximum(share, 1.0 / np.maximum(sample_count, 1))
    return larger
