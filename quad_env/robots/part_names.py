"""Names of a robot's parts in the scene: prefixes of attached parts, numbers of equal parts, foot geoms."""

import re
from collections.abc import Iterable
from typing import Any

ATTACH_PREFIX = "own/"
"""Prefix in the scene of the names of a user's model."""
RENAMED_PREFIX = "@"
"""Prefix, until the attachment, of parts that get a name of the scene."""


def scene_name(name: str) -> str:
    """Return the name of an attached part in the scene: the prefixes go if the part was renamed."""
    return name.removeprefix(ATTACH_PREFIX + RENAMED_PREFIX)


def numbered_name(name: str, number: int) -> str:
    """Return `name` for the first of several parts (`number` 0), `name_2` for the second, and so on."""
    return name if number == 0 else f"{name}_{number + 1}"


def names_of_part(name: str, names: Iterable[str]) -> list[str]:
    """Return the entries of `names` that `numbered_name` makes of `name`."""
    return [each for each in names if re.fullmatch(rf"{re.escape(name)}(_\d+)?", each)]


def foot_geoms(model: Any, leg: str) -> list[int]:
    """Return the ids of the foot geoms of the leg named `leg` in `model`, a compiled scene."""
    names = [model.geom(number).name for number in range(model.ngeom)]
    return [model.geom(name).id for name in names_of_part(f"{leg}_foot", names)]
