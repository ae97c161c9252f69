"""Registration of the environment with Gymnasium, which also works before Gymnasium is imported.

This module does not import Gymnasium and NumPy, because their import takes a quarter of a second. A command that only
prints its help needs neither package. A command that limits memory or handles Ctrl-C must do so before the import.
"""

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import ModuleType
from typing import Any

ENV_ID = "SimpleQuad-v0"
"""Name of the environment in Gymnasium's registry, for `gym.make`."""
MAX_EPISODE_STEPS = 1000
"""Default duration of an episode in control steps; `gym.make` truncates episodes after it."""


def register() -> None:
    """Register the environment with Gymnasium: now, or at the end of the first import of Gymnasium."""
    if (gymnasium := sys.modules.get("gymnasium")) is not None:
        _add_to(gymnasium)
    else:
        sys.meta_path.insert(0, _WithGymnasium())


class _WithGymnasium(MetaPathFinder):
    """Import hook that registers the environment at the end of the first import of Gymnasium."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the import specification of Gymnasium, with a loader that registers the environment.

        Python's import system calls this method for each module that is imported.

        Args:
            fullname: Name of the imported module.
            path: Folders in which the module's package searches its modules; None for a top-level module.
            target: Module that is reloaded; None for a first import.

        Returns:
            Specification for the import of Gymnasium; None for every other module.
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
    """Add the environment to the registry of the module `gymnasium`, unless the registry contains it."""
    if ENV_ID not in gymnasium.registry:
        gymnasium.register(
            ENV_ID,
            entry_point="quad_env.envs.env:SimpleQuadEnv",
            vector_entry_point="quad_env.envs.scenario_groups:make_vector_env",
            max_episode_steps=MAX_EPISODE_STEPS,
        )
