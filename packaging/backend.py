"""Build backend: hatchling without its shortcut to the metadata of a wheel that is not built.

The shortcut leaves out the dependencies that `editable_dependencies.py` adds. Without the shortcut, every installer
builds the wheel and reads its metadata. pip does so with hatchling itself too, and uv does not.
"""

from hatchling.build import (
    build_editable,
    build_sdist,
    build_wheel,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    get_requires_for_build_wheel,
)

__all__ = [
    "build_editable",
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_editable",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
]
