"""Per-robot controller state, which is allocated, reset and copied by robot, and gains of filters.

A class declares each array with `per_robot`. The array is an ordinary attribute of its object, with one entry per
robot along one axis. `initialize_state` allocates it for one robot in the constructor; `allocate` does so for n robots.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_FROM_CONSTRUCTOR = object()
"""Marks an array that gets its initial value from the constructor, by `initialize_state`."""


@dataclass(frozen=True, eq=False)
class PerRobotArray:
    """Declaration of an array with one entry per robot; made by `per_robot`."""

    initial: Any
    """Initial value of one robot, or a function of the object that returns it."""
    axis: int
    """Index of the array axis that runs over the robots."""


def per_robot(initial: Any = _FROM_CONSTRUCTOR, axis: int = 0) -> Any:
    """Declare an array of a `Policy` or a `PerRobotState` that has one entry per robot.

    Args:
        initial: Initial value of one robot; it gives the type of the array and the rest of its shape. A function is
            called with the object at each reset. Omitted: the constructor passes the value to `initialize_state`.
        axis: Index of the array axis that runs over the robots.

    Returns:
        The declaration, of type Any, so that the attribute can be annotated as an array.
    """
    return PerRobotArray(initial, axis)


class PerRobotState:
    """Base class of per-robot state.

    Arrays declared with `per_robot` have one entry per robot. Nested `PerRobotState` attributes, also inside dicts, are
    allocated, reset and copied along. A subclass calls this constructor at the end of its own.

    Args:
        **initial_values: Initial values of the arrays that are declared without one, by name.
    """

    def __init__(self, **initial_values: ArrayLike) -> None:
        initialize_state(self, **initial_values)

    def reset(self, num_envs: int) -> None:
        """Allocate fresh state for `num_envs` robots."""
        allocate(self, num_envs)

    def reset_where(self, mask: NDArray[np.bool_]) -> None:
        """Reset the robots where `mask`, (n,), is true."""
        reset_rows(self, mask)

    def copy_state_from(self, mask: NDArray[np.bool_], other: Any) -> None:
        """Copy the state of another object of the same class.

        Args:
            mask: Robots that receive a state, (n,) bool.
            other: Object with as many robots as `mask` selects.
        """
        copy_rows(self, mask, other)


def initialize_state(owner: Any, **initial_values: ArrayLike) -> None:
    """Allocate the declared arrays of an object for one robot; called at the end of its constructor.

    The function skips an array if its initial value is a function or is not known yet. A later call, or `allocate`,
    allocates this array.

    Args:
        owner: Object of a class that declares the arrays.
        **initial_values: Initial values of the arrays that are declared without one, by name.

    Raises:
        TypeError: A name is not declared.
    """
    arrays = declared_arrays(owner)
    if unknown := initial_values.keys() - arrays.keys():
        raise TypeError(f"{type(owner).__name__}: no array {', '.join(sorted(unknown))} declared with per_robot")
    values: dict[str, Any] = vars(owner).setdefault("_initial_values", {})
    values.update(initial_values)
    for name, array in arrays.items():
        if name in values or not (array.initial is _FROM_CONSTRUCTOR or callable(array.initial)):
            setattr(owner, name, _initial_value(owner, name, array).copy())


def is_allocated(owner: Any) -> bool:
    """Return True if every declared array of the object is allocated."""
    return all(name in vars(owner) for name in declared_arrays(owner))


def allocate(owner: Any, num_envs: int) -> None:
    """Allocate the declared arrays of `owner` and its nested states for `num_envs` robots."""
    for name, array in declared_arrays(owner).items():
        setattr(owner, name, np.repeat(_initial_value(owner, name, array), num_envs, array.axis))
    for state in nested_states(owner):
        state.reset(num_envs)


def reset_rows(owner: Any, mask: NDArray[np.bool_]) -> None:
    """Reset the declared arrays and nested states of some robots.

    Each array is replaced by a new one. References that callers hold to the previous arrays keep their values.

    Args:
        owner: Object that holds the state.
        mask: Robots to reset, (n,) bool.
    """
    for name, array in declared_arrays(owner).items():
        _set_robots(owner, name, array.axis, mask, _initial_value(owner, name, array))
    for state in nested_states(owner):
        state.reset_where(mask)


def copy_rows(owner: Any, mask: NDArray[np.bool_], other: Any) -> None:
    """Copy the declared arrays and nested states of another object of the same class.

    Args:
        owner: Object that receives the state.
        mask: Robots of `owner` that receive a state, (n,) bool.
        other: Object with as many robots as `mask` selects.
    """
    for name, array in declared_arrays(owner).items():
        _set_robots(owner, name, array.axis, mask, getattr(other, name))
    for state, other_state in zip(nested_states(owner), nested_states(other), strict=True):
        state.copy_state_from(mask, other_state)


def declared_arrays(owner: Any) -> Mapping[str, PerRobotArray]:
    """Return the `per_robot` declarations of an object's class and its base classes, name -> declaration."""
    owner_class: Any = type(owner)
    return _declared_by_class(owner_class)


@cache
def _declared_by_class(owner_class: type) -> Mapping[str, PerRobotArray]:
    """Return the dictionary name -> declaration of the arrays of a class and its base classes."""
    return {
        name: array
        for base in reversed(owner_class.__mro__)
        for name, array in vars(base).items()
        if isinstance(array, PerRobotArray)
    }


def nested_states(owner: Any) -> Iterator[PerRobotState]:
    """Yield the attributes of `owner`, and the values of its dicts, that are a `PerRobotState`."""
    for attribute in vars(owner).values():
        for value in attribute.values() if isinstance(attribute, dict) else (attribute,):
            if isinstance(value, PerRobotState):
                yield value


def _initial_value(owner: Any, name: str, array: PerRobotArray) -> NDArray[Any]:
    """Return the initial value of one robot, with an axis of length one for the robots."""
    values: dict[str, Any] = vars(owner).get("_initial_values", {})
    value = values.get(name, array.initial)
    if value is _FROM_CONSTRUCTOR:
        raise TypeError(f"{type(owner).__name__}.{name}: no initial value; pass it to initialize_state")
    return np.expand_dims(value(owner) if callable(value) else value, array.axis)


def _set_robots(owner: Any, name: str, axis: int, mask: NDArray[np.bool_], values: NDArray[Any]) -> None:
    """Replace an array by a copy with the given values of some robots."""
    array = getattr(owner, name).copy()
    array[(slice(None),) * axis + (mask,)] = values
    setattr(owner, name, array)


def lowpass_gain(control_period: float, time_constant: float) -> float:
    """Return the gain dt / (dt + time_constant) of a first-order low-pass filter.

    Args:
        control_period: Time between two samples, dt, s.
        time_constant: Time constant of the filter, s.

    Returns:
        Fraction of a change that the filter takes up per sample.
    """
    return control_period / (control_period + time_constant)


def warm_start_gain(gain: float | NDArray[np.float64], sample_count: NDArray[Any]) -> NDArray[np.float64]:
    """Return max(gain, 1 / sample_count): a running mean until the memory of the filter is full.

    Args:
        gain: Gain of the filter in the long run, see `lowpass_gain`.
        sample_count: Samples since the reset, the present one included; zero counts as one.

    Returns:
        Gain for the present sample; its shape is the broadcast shape of `gain` and `sample_count`.
    """
    larger: NDArray[np.float64] = np.maximum(gain, 1.0 / np.maximum(sample_count, 1))
    return larger
