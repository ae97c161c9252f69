"""Registration of the environment with Gymnasium, without importing Gymnasium.

Gymnasium is not imported because the import of Gymnasium and NumPy takes a quarter of a second. A command that prints
its help needs neither package. A command that limits memory or handles Ctrl-C must do this before the import.
"""

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import ModuleType
from typing import Any

ENV_ID = "SimpleQuad-v0"
"""Name of the environment in Gymnasium's registry."""
MAX_EPISODE_STEPS = 1000
"""Default time limit, control steps."""


def register() -> None:
    """Register the environment with Gymnasium, at once or at the end of Gymnasium's first import."""
    if (gymnasium := sys.modules.get("gymnasium")) is not None:
        _add_to(gymnasium)
    else:
        sys.meta_path.insert(0, _WithGymnasium())


class _WithGymnasium(MetaPathFinder):
    """Import hook that registers the environment at the end of the first import of Gymnasium."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the module specification of Gymnasium, with a loader that registers the environment.

        Args:
            fullname: Name of the imported module.
            path: Search path of the package of the module.
            target: Module that is reloaded; None for a first import.

        Returns:
            Specification of Gymnasium; None for every other module.
        """
        if fullname != "gymnasium":
            return None
        sys.meta_path.remove(self)
        spec = find_spec(fullname)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def execute_and_register(module: ModuleType) -> None:
                execute(module)
                _add_to(module)

            spec.loader.exec_module = execute_and_register  # type: ignore[method-assign]
        return spec


def _add_to(gymnasium: Any) -> None:
    """Add the environment to Gymnasium's registry if the registry does not contain it."""
    if ENV_ID not in gymnasium.registry:
        gymnasium.register(
            ENV_ID,
            entry_point="quad_env.envs.env:SimpleQuadEnv",
            vector_entry_point="quad_env.envs.vector_env:SimpleQuadVectorEnv",
            max_episode_steps=MAX_EPISODE_STEPS,
        )
