"""Checks of what callers hand to the environment: each gives the value in its own type or a ValueError that helps."""

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

from quad_env.columns import Array, Mask
from quad_env.config import COMMAND_BOUND
from quad_env.files.text import brief

MOST_PIXELS = 8192
"""Longest side of a frame."""
MOST_THREADS = 1024
"""Largest number of threads of a batch."""
RESET_OPTIONS = ("command", "reset_mask")


def check_count(name: str, count: Any) -> int:
    """Return a whole number of at least 1 as Python's own type. Raises ValueError for anything else."""
    if isinstance(count, bool) or not isinstance(count, int | np.integer):
        raise ValueError(f"{name} is a whole number of at least 1, got {brief(count)}")
    if count < 1:
        raise ValueError(f"{name} must be at least 1, got {brief(int(count))}")
    return int(count)


def check_frame(width: int, height: int) -> None:
    """Refuse a frame that is not of whole pixels."""
    for name, pixels in (("width", width), ("height", height)):
        if isinstance(pixels, bool) or not isinstance(pixels, int | np.integer) or not 1 <= pixels <= MOST_PIXELS:
            raise ValueError(f"{name} is a whole number of pixels from 1 to {MOST_PIXELS}, got {pixels!r}")


def warn_of_no_render_mode(modes: Sequence[str]) -> None:
    """Gymnasium's own environments warn too, and render nothing."""
    gym.logger.warn(f"render() without a render_mode gives None; make the environment with one of {', '.join(modes)}")


def reset_options(options: Any, num_envs: int) -> tuple[Mask, Array | None]:
    """Which envs to reset, (num_envs,), and the commands that they are to hold, (num_envs, 3), None to draw them."""
    found = {} if options is None else options
    if not isinstance(found, Mapping):
        raise ValueError(f"options must be a dict with some of {', '.join(RESET_OPTIONS)}, got {options!r:.80}")
    if unknown := set(found) - set(RESET_OPTIONS):
        raise ValueError(f"unknown options {sorted(map(str, unknown))}; valid: {', '.join(RESET_OPTIONS)}")
    command = found.get("command")
    fixed_command = None if command is None else commands(command, num_envs, "options['command']")
    return _mask(found.get("reset_mask"), num_envs), fixed_command


def commands(command: Any, num_envs: int, name: str) -> Array:
    """Commands (num_envs, 3), given as one for all or one each."""
    array = rows(command, (num_envs, 3), name)
    if not (np.abs(array) <= COMMAND_BOUND).all():
        raise ValueError(f"{name} must be finite and within ±{COMMAND_BOUND:g}")
    return array


def rows(values: Any, shape: tuple[int, int], name: str) -> Array:
    """Finite numbers of that shape, given as one row for all or a row each."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be numbers of shape {shape[1:]} or {shape}, got {brief(values)}") from None
    if array.shape not in (shape[1:], shape):
        raise ValueError(f"{name} has shape {array.shape}; wanted {shape[1:]} or {shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite")
    return np.broadcast_to(array, shape).copy()


def _mask(mask: Any, num_envs: int) -> Mask:
    """Which envs to reset, (num_envs,); all of them for None."""
    if mask is None:
        return np.ones(num_envs, bool)
    array = np.asarray(mask)
    if array.shape != (num_envs,) or array.dtype != bool:
        raise ValueError(f"options['reset_mask'] must be a bool array of shape ({num_envs},), got {array.shape}")
    return array


def find_autoreset_mode(mode: AutoresetMode | str) -> AutoresetMode:
    """The mode of that name or value, or the mode itself."""
    names = AutoresetMode.__members__
    try:
        return names[mode] if isinstance(mode, str) and mode in names else AutoresetMode(mode)
    except ValueError:
        raise ValueError(f"unknown autoreset_mode {mode!r}; valid: {', '.join(names)}") from None


def joint_targets(actions: Any, shape: tuple[int, ...], lower: Array, upper: Array) -> Array:
    """Joint targets of the given `shape`, rad, clipped to the joints' limits, (12,)."""
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
