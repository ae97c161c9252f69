"""The environment in Gymnasium's registry, without loading Gymnasium.

Gymnasium takes a quarter of a second to load, and NumPy with it. A command that prints its help needs neither, and one
that wants memory or Ctrl-C handled must say so before they load.
"""

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import ModuleType
from typing import Any

ENV_ID = "SimpleQuad-v0"
MAX_EPISODE_STEPS = 1000


def register() -> None:
    """Register the environment with Gymnasium: now where Gymnasium is loaded, else as soon as it is."""
    if (gymnasium := sys.modules.get("gymnasium")) is not None:
        _add_to(gymnasium)
    else:
        sys.meta_path.insert(0, _WithGymnasium())


class _WithGymnasium(MetaPathFinder):
    """Import hook that registers the environment at the end of the first import of Gymnasium."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Specification of Gymnasium, whose loading ends with the registration; None for every other module."""
        if fullname != "gymnasium":
            return None
        sys.meta_path.remove(self)
        found = find_spec(fullname)
        if found is not None and found.loader is not None:
            load = found.loader.exec_module

            def load_and_register(module: ModuleType) -> None:
                load(module)
                _add_to(module)

            found.loader.exec_module = load_and_register  # type: ignore[method-assign]
        return found


def _add_to(gymnasium: Any) -> None:
    if ENV_ID not in gymnasium.registry:
        gymnasium.register(
            ENV_ID,
            entry_point="quad_env.envs.env:SimpleQuadEnv",
            vector_entry_point="quad_env.envs.vector_env:SimpleQuadVectorEnv",
            max_episode_steps=MAX_EPISODE_STEPS,
        )
