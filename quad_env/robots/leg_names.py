"""Check that the joint names of a user's robot agree with the positions of the legs.

The words of a joint's name show its leg: `FL_hip_joint` and `front_left_hip` both mean the front left leg, fl. If the
names contradict the positions of the legs, the model most often faces backward.
"""

import re
from collections.abc import Iterator, Sequence

from quad_env.robots.robot import Robot
from quad_env.robots.structure import JOINTS_PER_LEG, LEG_WORDS

LEG_POSITIONS = {"fl": "front left", "fr": "front right", "hl": "hind left", "hr": "hind right"}
"""Name of a leg (f: front, h: hind, l: left, r: right) -> its position in words, for messages."""
_ENDS = {"front": "f", "fore": "f", "hind": "h", "rear": "h", "back": "h"}
"""Word of a joint's name that means the front or hind end -> first letter of the leg's name."""
_SIDES = {"left": "l", "l": "l", "right": "r", "r": "r"}
"""Word of a joint's name that means the left or right side -> second letter of the leg's name."""
_JOINED_WORDS = re.compile(f"({'|'.join(_ENDS)})(left|right)|(left|right)({'|'.join(_ENDS)})")
"""Pattern of a word that contains both an end and a side of the robot, such as `frontleft`."""
_WORD = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+")
"""Pattern of one word in a joint's name; a change from lower to upper case starts a new word."""
_MIRROR = str.maketrans("lr", "rl")
"""Translation of a leg's name that exchanges left and right, for `str.translate`."""
_REVERSE = str.maketrans("fh", "hf")
"""Translation of a leg's name that exchanges front and hind, for `str.translate`."""
_TURNS = {
    "the model faces backward (its x axis points to the tail): turn it by 180° about z": (_MIRROR, _REVERSE),
    "left and right are exchanged (its y axis points to the right?): y points to the left": (_MIRROR,),
    "fore and hind are exchanged (its x axis points to the tail?): x points forward": (_REVERSE,),
}
"""Cause and remedy of wrong joint names -> translations of the leg's name in a joint's name to its actual leg.

A cause applies if its translations explain all wrong names.
"""

PARTIAL_REMEDY = "the other legs are where their names say: exchange the names of these, or their places"
"""Text of the remedy for the user, if the names of only some legs contradict their positions."""


def split_words(name: str) -> list[str]:
    """Split a joint's name such as `FL_hip_joint` into its words in lower case: fl, hip, joint."""
    words = [word.lower() for word in _WORD.findall(name)]
    return [part for word in words for part in _parts(word)]


def _parts(word: str) -> list[str]:
    match = _JOINED_WORDS.fullmatch(word)
    return [part for part in match.groups() if part] if match else [word]


def leg_from_words(words: Sequence[str]) -> str | None:
    """Return the name of the leg that the words of a joint's name mean: fl, fr, hl or hr.

    The letters mean front, hind, left and right. None is returned if the words name no leg or more than one leg.
    """
    known = {LEG_WORDS[word] for word in words if word in LEG_WORDS}
    ends = {_ENDS[word] for word in words if word in _ENDS}
    sides = {_SIDES[word] for word in words if word in _SIDES}
    if not known and len(ends) == len(sides) == 1:
        known = {ends.pop() + sides.pop()}
    return known.pop() if len(known) == 1 else None


def find_contradictions(robot: Robot) -> Iterator[str]:
    """Yield a warning with the joint names that contradict the positions of their legs, and the remedy.

    At most one line is yielded; no line is yielded if all names agree with the positions.
    """
    named = [leg_from_words(split_words(name)) for name in robot.joint_names]
    places = [leg for leg in robot.leg_names for _ in range(JOINTS_PER_LEG)]
    wrong = [
        (name, leg, place)
        for name, leg, place in zip(robot.joint_names, named, places, strict=True)
        if leg is not None and leg != place
    ]
    if not wrong:
        return
    examples = {(leg, place): name for name, leg, place in reversed(wrong)}
    pairs = ", ".join(f"{name} is {LEG_POSITIONS[place]}" for (_, place), name in reversed(examples.items()))
    all_wrong = len(wrong) == sum(leg is not None for leg in named)
    yield f"names and places disagree: {pairs}; {_remedy(examples) if all_wrong else PARTIAL_REMEDY}"


def _remedy(wrong: dict[tuple[str, str], str]) -> str:
    for remedy, maps in _TURNS.items():
        turned = {(_translate_leg(leg, maps), place) for leg, place in wrong}
        if all(leg == place for leg, place in turned):
            return remedy
    return "exchange the names, or the places"


def _translate_leg(leg: str, maps: Sequence[dict[int, int]]) -> str:
    for each in maps:
        leg = leg.translate(each)
    return leg
