"""Checks of the environment's arguments: each returns the value in its own type or raises a ValueError that helps."""

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

from quad_env.columns import Array, Mask
from quad_env.config import COMMAND_BOUND
from quad_env.files.text import brief

MAX_PIXELS = 8192
"""Maximum width and height of a frame, pixels."""
MAX_THREADS = 1024
"""Maximum number of threads of a batch."""
RESET_OPTIONS = ("command", "reset_mask")
"""Valid keys of the reset options."""


def check_count(name: str, count: Any) -> int:
    """Return a whole number of at least 1 as Python's own type.

    Args:
        name: Name of the argument, for the message.
        count: Its value.

    Returns:
        The count.

    Raises:
        ValueError: The value is no whole number of at least 1.
    """
    if isinstance(count, bool) or not isinstance(count, int | np.integer):
        raise ValueError(f"{name} is a whole number of at least 1, got {brief(count)}")
    if count < 1:
        raise ValueError(f"{name} must be at least 1, got {brief(int(count))}")
    return int(count)


def check_frame(width: int, height: int) -> None:
    """Check the size of a frame.

    Args:
        width: Pixels.
        height: Pixels.

    Raises:
        ValueError: A size is no whole number of pixels from 1 to `MAX_PIXELS`.
    """
    for name, pixels in (("width", width), ("height", height)):
        if isinstance(pixels, bool) or not isinstance(pixels, int | np.integer) or not 1 <= pixels <= MAX_PIXELS:
            raise ValueError(f"{name} is a whole number of pixels from 1 to {MAX_PIXELS}, got {pixels!r}")


def warn_no_render_mode(modes: Sequence[str]) -> None:
    """Warn that rendering without one of the render `modes` returns None, as Gymnasium's environments do."""
    gym.logger.warn(f"render() without a render_mode gives None; make the environment with one of {', '.join(modes)}")


def parse_reset_options(options: Any, num_envs: int) -> tuple[Mask, Array | None]:
    """Parse the options of a reset.

    Args:
        options: Mapping with some of `RESET_OPTIONS`, or None.
        num_envs: Number of robots n.

    Returns:
        reset_mask: True for robots to reset, (n,).
        command: Fixed commands, (n, 3), see `check_commands`; None to draw them.

    Raises:
        ValueError: The options are no mapping, or a key or value is invalid.
    """
    given = {} if options is None else options
    if not isinstance(given, Mapping):
        raise ValueError(f"options must be a dict with some of {', '.join(RESET_OPTIONS)}, got {options!r:.80}")
    if unknown := set(given) - set(RESET_OPTIONS):
        raise ValueError(f"unknown options {sorted(map(str, unknown))}; valid: {', '.join(RESET_OPTIONS)}")
    command = given.get("command")
    fixed_command = None if command is None else check_commands(command, num_envs, "options['command']")
    return _check_reset_mask(given.get("reset_mask"), num_envs), fixed_command


def check_commands(command: Any, num_envs: int, name: str) -> Array:
    """Return a velocity command for every robot.

    Args:
        command: Forward velocity, m/s, lateral velocity, m/s, and yaw rate, rad/s: (3,) for all or (n, 3).
        num_envs: Number of robots n.
        name: Name of the argument, for the message.

    Returns:
        Commands, (n, 3).

    Raises:
        ValueError: The command has a wrong shape, is not finite or beyond `COMMAND_BOUND`.
    """
    commands = check_rows(command, (num_envs, 3), name)
    if not (np.abs(commands) <= COMMAND_BOUND).all():
        raise ValueError(f"{name} must be finite and within ±{COMMAND_BOUND:g}")
    return commands


def check_rows(values: Any, shape: tuple[int, int], name: str) -> Array:
    """Return finite numbers as an array of one row per robot.

    Args:
        values: One row for all, or one per robot.
        shape: Shape of the result.
        name: Name of the argument, for the message.

    Returns:
        A new array of that shape.

    Raises:
        ValueError: The values are no finite numbers of one of the shapes.
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
    """Return the mask of robots to reset, (num_envs,); all True for None."""
    if mask is None:
        return np.ones(num_envs, bool)
    array = np.asarray(mask)
    if array.shape != (num_envs,) or array.dtype != bool:
        raise ValueError(f"options['reset_mask'] must be a bool array of shape ({num_envs},), got {array.shape}")
    return array


def parse_autoreset_mode(mode: AutoresetMode | str) -> AutoresetMode:
    """Return the autoreset mode with that name or value, or the mode itself; raise ValueError for an unknown one."""
    names = AutoresetMode.__members__
    try:
        return names[mode] if isinstance(mode, str) and mode in names else AutoresetMode(mode)
    except ValueError:
        raise ValueError(f"unknown autoreset_mode {mode!r}; valid: {', '.join(names)}") from None


def check_joint_targets(actions: Any, shape: tuple[int, ...], lower: Array, upper: Array) -> Array:
    """Return the joint targets of an action, clipped to the joint limits.

    Args:
        actions: Joint targets, rad.
        shape: Their required shape, (12,) or (n, 12).
        lower: Lower joint limits, (12,), rad.
        upper: Upper joint limits, (12,), rad.

    Returns:
        A new array of clipped targets, rad.

    Raises:
        ValueError: The targets are no finite real numbers of that shape.
    """
    array = np.asarray(actions)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"an action is real joint targets in rad, got {array.dtype}")
    if array.shape != shape:
        raise ValueError(f"the action has shape {array.shape}; wanted {shape} joint targets in rad")
    targets: Array = array.astype(np.float64)
    if np.count_nonzero(np.isfinite(targets)) < targets.size:
        raise ValueError("an action is finite joint targets in rad")
    np.maximum(targets, lower, out=targets)
    return np.minimum(targets, upper, out=targets)
