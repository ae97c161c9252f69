"""What a controller remembers of each of n robots from one control step to the next, and filters of it."""

from collections import defaultdict
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Field:
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

    def of_one(self, owner: Any) -> NDArray[Any]:
        """The array of one robot at its start."""
        return np.expand_dims(self._start(owner) if callable(self._start) else self._start, self.axis)


_FIELDS = defaultdict[type, list[Field]](list)
"""By the class that has them."""


def per_robot(start: Any, axis: int = 0) -> Any:
    """A field of a class that has `reset`, see `Field`; `start` gives the array's type and the rest of its shape."""
    return Field(start, axis)


class Memory:
    """What has fields `per_robot`; its attributes that are such, and those in its dictionaries, begin with it."""

    def reset(self, num_envs: int) -> None:
        """Fresh memory of so many robots."""
        begin(self, num_envs)

    def reset_where(self, mask: NDArray[np.bool_]) -> None:
        """Fresh memory of the robots where the mask, (n,), is true."""
        begin_again(self, mask)

    def take_over(self, mask: NDArray[np.bool_], other: Any) -> None:
        """Go on where the mask, (n,), is true with the robots of another one of the same kind, as many as these."""
        take_over(self, mask, other)


def begin(owner: Any, num_envs: int) -> None:
    """Fresh fields of an object for so many robots."""
    for field in _fields(owner):
        setattr(owner, field.name, np.repeat(field.of_one(owner), num_envs, field.axis))
    for part in _parts(owner):
        part.reset(num_envs)


def begin_again(owner: Any, mask: NDArray[np.bool_]) -> None:
    """Fresh fields of an object for the robots where the mask, (n,), is true; arrays handed out stay what they were."""
    for field in _fields(owner):
        _put(owner, field, mask, field.of_one(owner))
    for part in _parts(owner):
        part.reset_where(mask)


def take_over(owner: Any, mask: NDArray[np.bool_], other: Any) -> None:
    """Put the fields of another object of the same kind where the mask, (n,), is true, as many robots as it has."""
    for field in _fields(owner):
        _put(owner, field, mask, getattr(other, field.name))
    for part, theirs in zip(_parts(owner), _parts(other), strict=True):
        part.take_over(mask, theirs)


def _put(owner: Any, field: Field, mask: NDArray[np.bool_], values: NDArray[Any]) -> None:
    now = getattr(owner, field.name).copy()
    now[(*[slice(None)] * field.axis, mask)] = values
    setattr(owner, field.name, now)


def _fields(owner: Any) -> list[Field]:
    return [field for kind in reversed(type(owner).__mro__) for field in _FIELDS.get(kind, ())]


def _parts(owner: Any) -> Iterator[Memory]:
    for value in vars(owner).values():
        for each in value.values() if isinstance(value, dict) else (value,):
            if isinstance(each, Memory):
                yield each


def taken_in(control_period: float, time_constant: float) -> float:
    """Share of a change that a first-order filter of that time constant takes in within a control period, both s."""
    return control_period / (control_period + time_constant)


def at_first_a_mean(share: float | NDArray[np.float64], looks: NDArray[Any]) -> NDArray[np.float64]:
    """Share that such a filter takes in at its k-th look, counted in `looks`, where until there are many it is their
    mean: at least 1 / k."""
    larger: NDArray[np.float64] = np.maximum(share, 1.0 / np.maximum(looks, 1))
    return larger
