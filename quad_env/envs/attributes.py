"""Check of assignments to environment attributes: an assignment that has no effect raises an error."""

from collections.abc import Iterable
from inspect import signature
from typing import Any

from quad_env.config import TaskConfig

GYMNASIUM_ATTRIBUTES = frozenset(("spec", "metadata", "np_random", "closed"))
"""Names of the attributes that Gymnasium sets on every environment; their assignment raises no error."""
SPACE_ATTRIBUTES = frozenset(("observation_space", "action_space", "single_observation_space", "single_action_space"))
"""Names of the attributes with observation and action spaces, which a subclass of an environment may replace."""
COMMAND_ATTRIBUTES = frozenset(("command", "commands", "command_ranges"))
"""Names of attributes that a user may try to assign in order to change the velocity command.

These attributes do not exist. The error message of the assignment shows the call that sets a command, for example
`reset` with the option "command".
"""
PACKAGE = __name__.rpartition(".")[0]
"""Name of the package of the environment classes; a class of another package is a user's subclass."""


def check_settable(env: Any, name: str, value: Any, parts: Iterable[str]) -> None:
    """Check the assignment of an environment's public attribute; raise AttributeError if it has no effect.

    An assignment has no effect if the environment reads the attribute only during construction.

    Args:
        env: Single or vector environment.
        name: Name of the assigned attribute.
        value: New value of the attribute, for the error message.
        parts: Names of the constructor arguments that the single and the vector environment share.

    Raises:
        AttributeError: The assignment would have no effect.
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
    elif name == "severity":
        fact = "is not read"
        valid = f'reset(options={{"severity": ...}}), or {make}(..., scenario=...)'
    else:
        fact = "can be read but not set" if is_own else "is no attribute of the environment"
        valid = ", ".join(sorted(env.SETTABLE))
    raise AttributeError(f"{kind.__name__}.{name}: {fact}, got {value!r:.80}; valid: {valid}")
