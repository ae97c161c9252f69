"""Naming of a robot's parts in the scene: prefixes of a user's parts, and numbers of equal parts."""

import re
from collections.abc import Iterable
from typing import Any

ATTACH_PREFIX = "own/"
"""Prefix of the names in the scene of parts that keep the name in the user's model."""
RENAMED_PREFIX = "@"
"""Prefix that marks renamed parts in a user's model; it is removed after the attachment to the scene."""


def scene_name(name: str) -> str:
    """Return the final name of an attached part.

    The prefixes are removed if the part was renamed.
    """
    return name.removeprefix(ATTACH_PREFIX + RENAMED_PREFIX)


def numbered_name(name: str, number: int) -> str:
    """Return the name of one of several parts: `name` for `number` 0, `name_2` for 1, and so on."""
    return name if number == 0 else f"{name}_{number + 1}"


def names_of_part(name: str, names: Iterable[str]) -> list[str]:
    """Return the entries of `names` that are `name`, or `name` with a number as in `numbered_name`."""
    return [each for each in names if re.fullmatch(rf"{re.escape(name)}(_\d+)?", each)]


def foot_geoms(model: Any, leg: str) -> list[int]:
    """Return the ids of the foot geoms of the leg named `leg` in the compiled scene `model`."""
    names = [model.geom(number).name for number in range(model.ngeom)]
    return [model.geom(name).id for name in names_of_part(f"{leg}_foot", names)]
