"""SimpleQuad: a quadruped locomotion environment; the import registers the environment with Gymnasium.

Call `gym.make("SimpleQuad-v0")` after this import. `gym.make("quad_env:SimpleQuad-v0")` works without the import, also
in worker processes. The file `__init__.pyi` lists the public names and their modules, as in Scientific Python's SPEC 1.
A module is imported when one of its public names is first used, so the import of this package is fast.
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
    """Import the module that defines the public name `name`, and return the object with this name."""
    if name == "__version__":
        return _version()
    if name not in _MODULE_BY_NAME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return globals().setdefault(name, getattr(import_module(_MODULE_BY_NAME[name]), name))


def __dir__() -> list[str]:
    """Return all public names of the package, including names from modules that are not imported yet."""
    return sorted({*globals(), *__all__, "__version__"})


def _version() -> str:
    """Return the version of the installed project, such as `1.2.0`; `0+unknown` if it is not installed."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("simple-quad")
    except PackageNotFoundError:  # The code runs from a source tree that is not installed.
        return "0+unknown"
