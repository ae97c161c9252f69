"""Checks of the arguments of the environments: a check returns the valid value, or raises ValueError."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

from quad_env.columns import Array, Mask
from quad_env.config import COMMAND_BOUND
from quad_env.files.text import brief
from quad_env.scenarios.registry import MAX_SEVERITY

MAX_PIXELS = 8192
"""Maximum width and height of a rendered image, pixels."""
MAX_THREADS = 1024
"""Maximum number of simulation threads of a vector environment."""
RESET_OPTIONS = ("command", "reset_mask", "severity")
"""Valid keys of the dictionary `options`, an argument of `reset`."""


def check_count(name: str, count: Any) -> int:
    """Check that an argument is a whole number of at least 1, and return it as an `int`.

    Args:
        name: Name of the argument, for the error message.
        count: Value of the argument.

    Returns:
        The value as an `int`.

    Raises:
        ValueError: The value is not a whole number of at least 1.
    """
    if isinstance(count, bool) or not isinstance(count, int | np.integer):
        raise ValueError(f"{name} is a whole number of at least 1, got {brief(count)}")
    if count < 1:
        raise ValueError(f"{name} must be at least 1, got {brief(int(count))}")
    return int(count)


def check_frame(width: int, height: int) -> None:
    """Check the size of a rendered image.

    Args:
        width: Width of the image, pixels.
        height: Height of the image, pixels.

    Raises:
        ValueError: The width or the height is not a whole number from 1 to `MAX_PIXELS`.
    """
    for name, pixels in (("width", width), ("height", height)):
        if isinstance(pixels, bool) or not isinstance(pixels, int | np.integer) or not 1 <= pixels <= MAX_PIXELS:
            raise ValueError(f"{name} is a whole number of pixels from 1 to {MAX_PIXELS}, got {pixels!r}")


def warn_no_render_mode(modes: Sequence[str]) -> None:
    """Log a warning that `render` returns None, because the environment was made without a `render_mode`.

    `modes` are the valid render modes, which the warning lists.
    """
    gym.logger.warn(f"render() without a render_mode gives None; make the environment with one of {', '.join(modes)}")


def parse_reset_options(options: Any, num_envs: int) -> tuple[Mask, Array | None, Array | None]:
    """Check the argument `options` of `reset`, and return the reset mask, the commands and the severities.

    Args:
        options: Mapping with the optional keys "command", "reset_mask" and "severity", or None for none.
        num_envs: Number of robots n.

    Returns:
        reset_mask: True for robots to reset, (n,).
        command: Velocity commands of all robots for the whole episode, (n, 3): forward m/s, lateral m/s, yaw rate
            rad/s. None if commands are drawn at random.
        severity: New severity of each robot's scenario, (n,), NaN for an unchanged one; None for no change.

    Raises:
        ValueError: The options are not a mapping, or a key or value is invalid.
    """
    given = {} if options is None else options
    if not isinstance(given, Mapping):
        raise ValueError(f"options must be a dict with some of {', '.join(RESET_OPTIONS)}, got {options!r:.80}")
    if unknown := set(given) - set(RESET_OPTIONS):
        raise ValueError(f"unknown options {sorted(map(str, unknown))}; valid: {', '.join(RESET_OPTIONS)}")
    command = given.get("command")
    fixed_command = None if command is None else check_commands(command, num_envs, "options['command']")
    severity = given.get("severity")
    severities = None if severity is None else _check_severities(severity, num_envs)
    return _check_reset_mask(given.get("reset_mask"), num_envs), fixed_command, severities


def _check_severities(severity: Any, num_envs: int) -> Array:
    """Check and return the severities of all robots, (num_envs,); NaN leaves the severity of a robot unchanged."""
    name = "options['severity']"
    try:
        array = np.asarray(severity, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name}: not a number for each robot, got {brief(severity)}") from None
    if array.shape not in ((), (num_envs,)):
        raise ValueError(f"{name}: wrong number of severities, got shape {array.shape}; valid: () or ({num_envs},)")
    if ((array < 0) | (array > MAX_SEVERITY)).any():
        raise ValueError(f"{name}: a severity is a number from 0 to {MAX_SEVERITY:g}, got {brief(severity)}")
    return np.broadcast_to(array + 0.0, (num_envs,)).copy()  # -0.0 becomes 0.0


def check_commands(command: Any, num_envs: int, name: str) -> Array:
    """Check a velocity command, and return it as an array with one row per robot.

    Args:
        command: Forward and lateral velocity, heading frame, m/s, and yaw rate, rad/s; (3,) for all robots, or (n, 3).
        num_envs: Number of robots n.
        name: Name of the argument, for the error message.

    Returns:
        Commands of the n robots in the same order and units, (n, 3).

    Raises:
        ValueError: The command has a wrong shape, is not finite, or exceeds ±`COMMAND_BOUND`.
    """
    commands = check_rows(command, (num_envs, 3), name)
    if not (np.abs(commands) <= COMMAND_BOUND).all():
        raise ValueError(f"{name} must be finite and within ±{COMMAND_BOUND:g}")
    return commands


def check_rows(values: Any, shape: tuple[int, int], name: str) -> Array:
    """Check that an argument holds finite numbers, and return them as an array with one row per robot.

    Args:
        values: One row of k numbers for all robots, or one row per robot, (k,) or (n, k).
        shape: Shape of the result, (n, k): n robots with k numbers each.
        name: Name of the argument, for the error message.

    Returns:
        A new array, (n, k).

    Raises:
        ValueError: The values are not finite numbers, or their shape is neither (k,) nor (n, k).
    """
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be numbers of shape {shape[1:]} or {shape}, got {brief(values)}") from None
    if array.shape not in (shape[1:], shape):
        raise ValueError(f"{name} has shape {array.shape}; wanted {shape[1:]} or {shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite")
    return np.broadcast_to(array, shape).copy()


def _check_reset_mask(mask: Any, num_envs: int) -> Mask:
    """Check and return the reset `mask`, (num_envs,) bool; if it is None, return True for all robots."""
    if mask is None:
        return np.ones(num_envs, bool)
    array = np.asarray(mask)
    if array.shape != (num_envs,) or array.dtype != bool:
        raise ValueError(f"options['reset_mask'] must be a bool array of shape ({num_envs},), got {array.shape}")
    return array


def parse_autoreset_mode(mode: AutoresetMode | str) -> AutoresetMode:
    """Return the Gymnasium autoreset mode with the name or value `mode`; a mode is returned unchanged.

    The mode defines the step in which a finished env resets itself. ValueError is raised for an unknown mode.
    """
    names = AutoresetMode.__members__
    try:
        return names[mode] if isinstance(mode, str) and mode in names else AutoresetMode(mode)
    except ValueError:
        raise ValueError(f"unknown autoreset_mode {mode!r}; valid: {', '.join(names)}") from None


def check_joint_targets(actions: Any, shape: tuple[int, ...], lower: Array, upper: Array) -> Array:
    """Check the joint targets of an action, and return them clipped to the joint limits.

    Args:
        actions: Joint targets, rad.
        shape: Required shape of the joint targets, (12,) or (n, 12).
        lower: Lower joint limits, (12,), rad.
        upper: Upper joint limits, (12,), rad.

    Returns:
        A new array of clipped targets, rad, with the shape `shape`.

    Raises:
        ValueError: The targets are not finite real numbers, or have another shape.
    """
    array = np.asarray(actions)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"an action is real joint targets in rad, got {array.dtype}")
    if array.shape != shape:
        raise ValueError(f"the action has shape {array.shape}; wanted {shape} joint targets in rad")
    targets: Array = array.astype(np.float64)
    if not _all_finite(targets):
        raise ValueError("an action is finite joint targets in rad")
    np.maximum(targets, lower, out=targets)
    return np.minimum(targets, upper, out=targets)


def _all_finite(targets: Array) -> bool:
    """Return True if all `targets` are finite, (12,) or (n, 12)."""
    # The sum is fast for the targets of one robot, but it may also overflow; then, each target is checked.
    if targets.ndim == 1 and math.isfinite(sum(targets.tolist())):
        return True
    return bool(np.count_nonzero(np.isfinite(targets)) == targets.size)
