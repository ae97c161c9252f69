"""Names of a model's parts: words of joints that mean a leg or a place in it, and numbers of parts of one kind."""

import re
from collections.abc import Iterable

LEG_WORDS = {word: words[:2] for words in ("fl lf", "fr rf", "hl rl lh bl", "hr rr rh br") for word in words.split()}
"""Leg by word; only words that mean one leg wherever they are used."""
LINK_WORDS = {"hip": "01", "haa": "0", "abad": "0", "thigh": "1", "hfe": "1", "calf": "2", "knee": "2", "kfe": "2"}
"""Places in the leg that a word may mean, counted from the trunk: some call the thigh's joint a hip too."""


def contradicts(name: str, leg: str, link: int) -> bool:
    """Whether a joint's name says another leg than this, fl, fr, hl or hr, or another place in it, 0, 1 or 2."""
    words = re.split(r"[^a-z]+", name.lower())
    return any(LEG_WORDS.get(word, leg) != leg or str(link) not in LINK_WORDS.get(word, str(link)) for word in words)


def numbered(name: str, number: int) -> str:
    """`name` of the first of several parts, counted from 0, `name_2` of the second, and so on."""
    return name if number == 0 else f"{name}_{number + 1}"


def of_name(name: str, names: Iterable[str]) -> list[str]:
    """Those of these names that `numbered` gives to parts of that name."""
    return [each for each in names if re.fullmatch(rf"{re.escape(name)}(_\d+)?", each)]
