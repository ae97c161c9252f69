"""Check of assignments to attributes of an environment: an assignment that would change nothing is an error."""

from collections.abc import Iterable
from inspect import signature
from typing import Any

from quad_env.config import TaskConfig

GYMNASIUM_ATTRIBUTES = frozenset(("spec", "metadata", "np_random", "closed"))
"""Attributes that Gymnasium sets."""
SPACE_ATTRIBUTES = frozenset(("observation_space", "action_space", "single_observation_space", "single_action_space"))
"""Attributes that a subclass may replace."""
COMMAND_ATTRIBUTES = frozenset(("command", "commands", "command_ranges"))
"""Names that users try for the command."""
PACKAGE = __name__.rpartition(".")[0]
"""Package of the environment classes; subclasses of users are outside of it."""


def check_settable(env: Any, name: str, value: Any, parts: Iterable[str]) -> None:
    """Refuse to set a public attribute that the environment does not read after it is made.

    Args:
        env: The environment.
        name: Attribute.
        value: Its new value, for the message.
        parts: Arguments that the single environment and the batch share.

    Raises:
        AttributeError: The assignment would change nothing.
    """
    kind = next(base for base in type(env).__mro__ if base.__module__.startswith(PACKAGE))
    if name in env.SETTABLE or name in GYMNASIUM_ATTRIBUTES or callable(getattr(kind, name, None)):
        return
    arguments = {*signature(kind).parameters, *parts} - {"parts"}
    is_own = name in arguments or hasattr(env, name)
    if type(env) is not kind and (name in SPACE_ATTRIBUTES or not is_own):
        return
    make = "gym.make_vec" if "num_envs" in arguments else "gym.make"
    if name in arguments:
        fact = "is fixed when the environment is made"
        valid = f"{make}(..., {name}=...)"
    elif name in TaskConfig.__dataclass_fields__:
        fact = "is fixed when the environment is made"
        valid = f"{make}(..., config=quad_env.TaskConfig({name}=...))"
    elif name in COMMAND_ATTRIBUTES:
        fact = "is not read"
        steer = " and steer(command)" if hasattr(env, "steer") else ""
        valid = f'reset(options={{"command": (forward, lateral, yaw_rate)}}){steer}, or {make}(..., scenario=...)'
    else:
        fact = "can be read but not set" if is_own else "is no attribute of the environment"
        valid = ", ".join(sorted(env.SETTABLE))
    raise AttributeError(f"{kind.__name__}.{name}: {fact}, got {value!r:.80}; valid: {valid}")
