"""SimpleQuad: a quadruped locomotion environment; importing registers it with Gymnasium and loads next to nothing.

`gym.make("SimpleQuad-v0")` after this import, or `gym.make("quad_env:SimpleQuad-v0")` anywhere, worker processes too.
The public names are listed in `__init__.pyi` only, as in Scientific Python's SPEC 1. A module is imported on first use
of one of its names.
"""

import re
from importlib import import_module
from pathlib import Path
from typing import Any

from quad_env.registration import register

_STUB = Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")
_MODULE_BY_NAME = {name: module for module, name in re.findall(r"^from (\S+) import (\w+) as", _STUB, re.MULTILINE)}
__all__ = [*_MODULE_BY_NAME]

register()


def __getattr__(name: str) -> Any:
    """Import the module of a public name, and return the name's value."""
    if name == "__version__":
        return _version()
    if name not in _MODULE_BY_NAME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return globals().setdefault(name, getattr(import_module(_MODULE_BY_NAME[name]), name))


def __dir__() -> list[str]:
    """Return all public names, also of modules that are not imported yet."""
    return sorted({*globals(), *__all__, "__version__"})


def _version() -> str:
    """Return the version of the installed distribution."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("simple-quad")
    except PackageNotFoundError:  # run from a source tree that is not installed
        return "0+unknown"
