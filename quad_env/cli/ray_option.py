"""Option --ray of commands that can run their tasks on a Ray cluster."""

from importlib.util import find_spec
from typing import Annotated

import tyro

from quad_env.cli.command_line import UsageError

RayOption = Annotated[
    tuple[str, ...] | None, tyro.conf.arg(metavar="[HOST:PORT]", help_behavior_hint="(default: none)")
]
"""Type of the option: None without it, `()` for `--ray`, and `("HOST:PORT",)` for `--ray HOST:PORT`."""


def parse_ray(option: tuple[str, ...]) -> str | None:
    """Return the address of the cluster that the option names, or None for a cluster that is started here.

    Args:
        option: Value of the option.

    Returns:
        The address, or None.

    Raises:
        UsageError: The option has more than one value.
        ModuleNotFoundError: Ray is not installed.
    """
    if find_spec("ray") is None:
        raise ModuleNotFoundError("No module named 'ray'", name="ray")
    if len(option) > 1:
        raise UsageError(f"--ray: more than one address, got {' '.join(option)}; valid: none or HOST:PORT")
    return option[0] if option else None
