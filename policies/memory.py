"""Per-robot state of controllers, and gains of low-pass filters.

The state consists of arrays with one axis that runs over the robots. This module allocates these arrays for n robots,
resets them for single robots, and copies them between objects. A class declares each array with `per_robot`. In an
object, the array is an ordinary attribute. `initialize_state` allocates the arrays for one robot in the constructor;
`allocate` allocates them for n robots.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_FROM_CONSTRUCTOR = object()
"""Marker in place of an initial value: the constructor of the object passes the value to `initialize_state`."""


@dataclass(frozen=True, eq=False)
class PerRobotArray:
    """Declaration of a state array with an axis over the robots, made by `per_robot`."""

    initial: Any
    """Initial value for one robot, or a function.

    The function gets the object that the array belongs to, and returns the initial value for one robot."""
    axis: int
    """Index of the array axis that runs over the robots."""


def per_robot(initial: Any = _FROM_CONSTRUCTOR, axis: int = 0) -> Any:
    """Declare a state array of a `Policy` or a `PerRobotState` with an axis over the robots.

    Args:
        initial: Initial value for one robot. The value defines the type of the array and its shape for one robot. If
            the argument is a function, it is called with the object at each reset, and returns the value. If the
            argument is omitted, the constructor of the object passes the value to `initialize_state`.
        axis: Index of the array axis that runs over the robots.

    Returns:
        The declaration. Its static type is Any, so that the attribute can be annotated as an array.
    """
    return PerRobotArray(initial, axis)


class PerRobotState:
    """Base class of objects with a separate state for each robot of a batch.

    A subclass declares its state arrays with `per_robot`. The subclass calls this constructor at the end of its own
    constructor. If an attribute of the object is itself a `PerRobotState`, this attribute is allocated, reset and
    copied together with the object. Attributes of type dict may also have values of type `PerRobotState`; these are
    treated in the same way.

    Args:
        **initial_values: Name of the array -> its initial value for one robot, for arrays that are declared without an
            initial value.
    """

    def __init__(self, **initial_values: ArrayLike) -> None:
        initialize_state(self, **initial_values)

    def reset(self, num_envs: int) -> None:
        """Allocate all state arrays for `num_envs` robots, with the initial values of each array."""
        allocate(self, num_envs)

    def reset_where(self, mask: NDArray[np.bool_]) -> None:
        """Set the state of the robots for which `mask`, (n,) bool, is True to the initial values."""
        reset_rows(self, mask)

    def copy_state_from(self, mask: NDArray[np.bool_], other: Any) -> None:
        """Copy the state of all robots of another object to some robots of this object.

        Args:
            mask: True for robots of this object that receive a state, (n,) bool.
            other: Object of the same class, with one robot for each True in `mask`.
        """
        copy_rows(self, mask, other)


def initialize_state(owner: Any, **initial_values: ArrayLike) -> None:
    """Allocate the state arrays of an object for one robot.

    The constructor of the object calls this function at its end. An array is skipped if its initial value is a
    function, or if no initial value was passed yet. A later call of `initialize_state` or of `allocate` allocates this
    array.

    Args:
        owner: Object of a class that declares arrays with `per_robot`.
        **initial_values: Name of the array -> its initial value for one robot, for arrays that are declared without an
            initial value.

    Raises:
        TypeError: The class declares no array with a given name.
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
    """Return True if every state array that the class of `owner` declares with `per_robot` is allocated."""
    attributes: dict[str, Any] = vars(owner)
    return declared_arrays(owner).keys() <= attributes.keys()


def allocate(owner: Any, num_envs: int) -> None:
    """Allocate the state arrays of `owner`, and of its nested state objects, for `num_envs` robots.

    Every robot gets the initial values that were declared with `per_robot`.

    Args:
        owner: Object of a class that declares the arrays.
        num_envs: Number of robots.
    """
    for name, array in declared_arrays(owner).items():
        setattr(owner, name, np.repeat(_initial_value(owner, name, array), num_envs, array.axis))
    for state in nested_states(owner):
        state.reset(num_envs)


def reset_rows(owner: Any, mask: NDArray[np.bool_]) -> None:
    """Set the state of some robots to the initial values, including nested state objects.

    Each array is replaced by a new array, so that an old array that a caller still uses does not change.

    Args:
        owner: Object with the state.
        mask: True for robots to reset, (n,) bool.
    """
    for name, array in declared_arrays(owner).items():
        _set_robots(owner, name, array.axis, mask, _initial_value(owner, name, array))
    for state in nested_states(owner):
        state.reset_where(mask)


def copy_rows(owner: Any, mask: NDArray[np.bool_], other: Any) -> None:
    """Copy the state of another object of the same class to some robots, including nested state objects.

    Args:
        owner: Object that receives the state.
        mask: True for robots of `owner` that receive a state, (n,) bool.
        other: Object with one robot for each True in `mask`.
    """
    for name, array in declared_arrays(owner).items():
        _set_robots(owner, name, array.axis, mask, getattr(other, name))
    for state, other_state in zip(nested_states(owner), nested_states(other), strict=True):
        state.copy_state_from(mask, other_state)


def declared_arrays(owner: Any) -> Mapping[str, PerRobotArray]:
    """Return the state arrays that the class of `owner` and its base classes declare with `per_robot`.

    The result is a dictionary array name -> declaration.
    """
    owner_class: Any = type(owner)
    return _declared_by_class(owner_class)


@cache
def _declared_by_class(owner_class: type) -> Mapping[str, PerRobotArray]:
    """Return the state arrays that a class and its base classes declare: array name -> declaration."""
    return {
        name: array
        for base in reversed(owner_class.__mro__)
        for name, array in vars(base).items()
        if isinstance(array, PerRobotArray)
    }


def nested_states(owner: Any) -> Iterator[PerRobotState]:
    """Yield the nested state objects of `owner`: its attributes that are a `PerRobotState` themselves.

    The values of type `PerRobotState` in attributes of type dict are nested state objects, too.
    """
    for attribute in vars(owner).values():
        for value in attribute.values() if isinstance(attribute, dict) else (attribute,):
            if isinstance(value, PerRobotState):
                yield value


def _initial_value(owner: Any, name: str, array: PerRobotArray) -> NDArray[Any]:
    """Return the initial value of the state array `name` of `owner` for one robot.

    `array` is the declaration of the array. The result has an additional axis of length one, the axis that later runs
    over the robots.
    """
    values: dict[str, Any] = vars(owner).get("_initial_values", {})
    value = values.get(name, array.initial)
    if value is _FROM_CONSTRUCTOR:
        raise TypeError(f"{type(owner).__name__}.{name}: no initial value; pass it to initialize_state")
    return np.expand_dims(value(owner) if callable(value) else value, array.axis)


def _set_robots(owner: Any, name: str, axis: int, mask: NDArray[np.bool_], values: NDArray[Any]) -> None:
    """Replace the state array `name` by a copy in which some robots have new values.

    Args:
        owner: Object with the array.
        name: Name of the array.
        axis: Index of the array axis that runs over the robots.
        mask: True for robots with new values, (n,).
        values: New array elements of these robots, with the robots along `axis`.
    """
    array = getattr(owner, name).copy()
    array[(slice(None),) * axis + (mask,)] = values
    setattr(owner, name, array)


def lowpass_gain(control_period: float, time_constant: float) -> float:
    """Return the gain dt / (dt + time_constant) of a first-order low-pass filter.

    Args:
        control_period: Time dt between two samples, s.
        time_constant: Time constant of the filter, s.

    Returns:
        Gain k, from 0 to 1, of the filter with output y and input x: y <- y + k (x - y) at each sample.
    """
    return control_period / (control_period + time_constant)


def warm_start_gain(gain: float | NDArray[np.float64], sample_count: NDArray[Any]) -> NDArray[np.float64]:
    """Return max(gain, 1 / sample_count), the gain of a low-pass filter that starts as a running mean.

    At first, the output of the filter is the mean of all samples since the reset. After 1 / `gain` samples, the filter
    has its constant gain.

    Args:
        gain: Gain of the filter after the start, see `lowpass_gain`.
        sample_count: Number of samples since the reset, including the current one. Zero counts as one.

    Returns:
        Gain for the current sample. Its shape is the broadcast shape of `gain` and `sample_count`.
    """
    larger: NDArray[np.float64] = np.maximum(gain, 1.0 / np.maximum(sample_count, 1))
    return larger
