"""Functions for the names of a robot's bodies, joints, geoms and sites in the simulated scene.

Names of parts of a user's model have prefixes, so that they differ from the names of other parts of the scene. Several
parts of the same kind, such as the geoms of one foot, are numbered.
"""

import re
from collections.abc import Iterable
from typing import Any

ATTACH_PREFIX = "own/"
"""Prefix in the scene of parts that keep their name from the user's model, such as `own/mount`."""
RENAMED_PREFIX = "@"
"""Prefix that marks renamed parts of a user's model until it is removed, such as `@base_link`.

The prefix is removed after the model has been attached to the scene.
"""


def scene_name(name: str) -> str:
    """Return the final name in the scene of a part of a user's robot.

    Args:
        name: Name of the part directly after its model was attached to the scene, with all prefixes.

    Returns:
        The name without prefixes if the part was renamed, such as `base_link`; else `name`, such as `own/mount`.
    """
    return name.removeprefix(ATTACH_PREFIX + RENAMED_PREFIX)


def numbered_name(name: str, number: int) -> str:
    """Return the name of one of several parts of the same kind: `name` for `number` 0, `name_2` for 1."""
    return name if number == 0 else f"{name}_{number + 1}"


def names_of_part(name: str, names: Iterable[str]) -> list[str]:
    """Return the items of `names` that are `name` itself, or `name` with a number such as `fl_foot_2`."""
    return [each for each in names if re.fullmatch(rf"{re.escape(name)}(_\d+)?", each)]


def foot_geoms(model: Any, leg: str) -> list[int]:
    """Return the ids of the foot geoms of a leg in the compiled scene `model`; `leg` is its name, such as fl."""
    names = [model.geom(number).name for number in range(model.ngeom)]
    return [model.geom(name).id for name in names_of_part(f"{leg}_foot", names)]
