"""Build hook of hatchling: an editable installation, that of a clone, also needs the extras `commands` and `bench`.

A clone has all packages of the project, and the wheel `simple-quad` has `quad_env` alone, with few dependencies.
"""

from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

EXTRAS = "commands", "bench"
"""Extras of pyproject.toml that an editable installation always installs."""


class EditableDependencies(BuildHookInterface[Any]):
    """Adds the packages of EXTRAS to the dependencies of an editable installation."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the dependencies before a build.

        Args:
            version: Kind of the wheel, `editable` or `standard`.
            build_data: Settings of the build, which are changed in place.
        """
        if version == "editable":
            optional = self.metadata.core.optional_dependencies
            build_data["dependencies"] += [line for extra in EXTRAS for line in optional[extra]]
