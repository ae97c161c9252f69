"""Import of optional packages only when a file needs them."""

from importlib import import_module
from importlib.util import find_spec
from typing import Any

from policies.base import PolicyError


def import_package(name: str, extra: str = "onnx") -> Any:
    """Import a module of an optional package.

    Args:
        name: Name of the module.
        extra: Optional dependency group of this project that installs the package, for the error.

    Returns:
        The module.

    Raises:
        PolicyError: The package is not installed.
    """
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        raise PolicyError(_missing_package(str(error.name), extra)) from None


def check_package(name: str, extra: str = "onnx") -> None:
    """Check that a module is installed, without loading it.

    Args:
        name: Name of the module.
        extra: Optional dependency group of this project that installs the package, for the error.

    Raises:
        PolicyError: The package is not installed.
    """
    if find_spec(name) is None:
        raise PolicyError(_missing_package(name, extra))


def _missing_package(name: str, extra: str) -> str:
    return f'this needs {name}, which is not installed: pip install -e ".[{extra}]"'
