"""Import of optional Python packages when a policy file needs them, with an error if they are missing."""

from importlib import import_module
from importlib.util import find_spec
from typing import Any

from policies.base import PolicyError
from quad_env.cli.extras import missing_package


def import_package(name: str, extra: str = "onnx") -> Any:
    """Import a module of an optional Python package.

    Args:
        name: Name of the module.
        extra: Optional dependency group of this project (`pip install .[extra]`) that installs the package. The error
            text names this group.

    Returns:
        The imported module.

    Raises:
        PolicyError: The package is not installed.
    """
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        raise PolicyError(missing_package(str(error.name), extra)) from None


def check_package(name: str, extra: str = "onnx") -> None:
    """Check that a module of an optional Python package is installed; the module is not imported.

    Args:
        name: Name of the module.
        extra: Optional dependency group of this project (`pip install .[extra]`) that installs the package. The error
            text names this group.

    Raises:
        PolicyError: The package is not installed.
    """
    if find_spec(name) is None:
        raise PolicyError(missing_package(name, extra))
