"""What a controller remembers of each of n robots from one control step to the next, and filters of it."""

from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


class Start(NamedTuple):
    """What an array starts with in the row of every robot, or a function of its owner that gives this."""

    value: Any
    axis: int
    """Of the robots."""


def per_robot(start: Any, axis: int = 0) -> Any:
    """A field of a class: an array of robots along that axis, the rest of its shape and its type those of `start`, or
    of what this gives, called with the object."""
    return Start(start, axis)


class Memory:
    """What has fields `per_robot`; its attributes that are such, and those in its dictionaries, begin with it."""

    def reset(self, num_envs: int) -> None:
        """Fresh memory of so many robots."""
        begin(self, num_envs)

    def reset_where(self, mask: NDArray[np.bool_]) -> None:
        """Fresh memory of the robots where the mask, (n,), is true."""
        begin_again(self, mask)


def begin(owner: object, num_envs: int) -> None:
    """Fresh fields of an object for so many robots."""
    for name, value, axis in _starts(owner):
        setattr(owner, name, np.repeat(np.expand_dims(value, axis), num_envs, axis))
    for part in _parts(owner):
        part.reset(num_envs)


def begin_again(owner: object, mask: NDArray[np.bool_]) -> None:
    """Fresh fields of an object for the robots where the mask, (n,), is true; arrays handed out stay what they were."""
    for name, value, axis in _starts(owner):
        now = getattr(owner, name).copy()
        np.moveaxis(now, axis, 0)[mask] = value
        setattr(owner, name, now)
    for part in _parts(owner):
        part.reset_where(mask)


def _starts(owner: object) -> Iterator[tuple[str, NDArray[Any], int]]:
    for name, (value, axis) in _fields(type(owner)).items():
        yield name, np.asarray(value(owner) if callable(value) else value), axis


@cache
def _fields(kind: type) -> dict[str, Start]:
    found = (vars(each).items() for each in reversed(kind.__mro__))
    return {name: value for items in found for name, value in items if isinstance(value, Start)}


def _parts(owner: object) -> Iterator[Memory]:
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
