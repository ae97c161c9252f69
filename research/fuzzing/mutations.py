"""Mutations of a valid file: of its values by key, of its elements, and of its bytes."""

import copy
import math
from typing import Any
from xml.etree import ElementTree

import numpy as np

Tree = Any
"""Nested dictionaries and lists of texts, numbers and None, as of a YAML file."""
ODD_VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, 1, -1, 0.0, 1e-300, 1e300, 1e9, -1e9, 1e-9, math.nan, math.inf, 10**30, 10**400),
    *("", "x", "1_0", "５", "1:30", "nan", "1e400", "x" * 5000, "((a*)*)*!", "(", "../..", "/dev/zero", "\x1b[31m"),
    *(
        [],
        {},
        [[]],
        [None] * 12,
        ["x"] * 12,
        [0.0] * 12,
        [1.0] * 11,
        list(range(12)),
        {"a": {}},
        {"x": 1.0},
        [[0, 1]] * 12,
    ),
)
ODD_TEXTS = (
    "",
    "x",
    "0",
    "-1",
    "1",
    "1e8",
    "1e300",
    "1e-300",
    "nan",
    "inf",
    "0 0 0",
    "1 2",
    "1e9 1e9 1e9",
    "９",
    "a" * 3000,
)
"""Of attributes of an XML file."""
ODD_BYTES = (
    b"\x00",
    b"\xff",
    b"\n",
    b"\t",
    b'"',
    b"{",
    b"[",
    b":",
    b"&a ",
    b"*a ",
    b"\x1b[0m",
    b"9" * 400,
    b"(" * 3000,
)
_SCALES = (0.0, -1.0, 0.1, 10.0, 1e3, 1e6, 1e12)


def places(tree: Tree) -> list[tuple[Any, Any]]:
    """Return all collections of a tree with each of their keys."""
    found, waiting = [], [tree]
    while waiting:
        now = waiting.pop()
        keys = list(now) if isinstance(now, dict) else range(len(now)) if isinstance(now, list) else ()
        for key in keys:
            found.append((now, key))
            waiting.append(now[key])
    return found


def mutate_tree(tree: Tree, rng: np.random.Generator, count: int = 1) -> Tree:
    """Return a copy of a tree with some changes at random places."""
    tree = copy.deepcopy(tree)
    for _ in range(count):
        if not (all_places := places(tree)):
            return tree
        holder, key = all_places[rng.integers(len(all_places))]
        value = holder[key]
        match int(rng.integers(9)):
            case 0 | 1:
                holder[key] = copy.deepcopy(ODD_VALUES[rng.integers(len(ODD_VALUES))])
            case 2:
                del holder[key]
            case 3:
                other, at = all_places[rng.integers(len(all_places))]
                holder[key] = copy.deepcopy(other[at])
            case 4:
                holder[key] = [value]
            case 5 if isinstance(holder, dict):
                holder[f"{key}x" if rng.integers(2) else ""] = holder.pop(key)
            case 6 if isinstance(value, list) and value:
                order = rng.permutation(len(value)).tolist()
                holder[key] = [value[each] for each in order]
            case 7 if isinstance(value, list) and value:
                holder[key] = value * int(rng.choice([2, 100, 10_000]))
            case _:
                if isinstance(value, int | float) and not isinstance(value, bool):
                    holder[key] = float(min(max(value, -1e300), 1e300)) * float(rng.choice(_SCALES))
    return tree


def mutate_bytes(content: bytes, rng: np.random.Generator, count: int = 1) -> bytes:
    """Return bytes with some of them changed, left out, put in, repeated or cut off."""
    for _ in range(count):
        at = int(rng.integers(len(content) + 1))
        length = int(rng.integers(1, 30))
        match int(rng.integers(6)):
            case 0:
                content = content[:at] + rng.bytes(1) + content[at + 1 :]
            case 1:
                content = content[:at] + content[at + length :]
            case 2:
                content = content[:at] + ODD_BYTES[rng.integers(len(ODD_BYTES))] + content[at:]
            case 3:
                content = content[:at] + content[at : at + length] * int(rng.choice([2, 50])) + content[at + length :]
            case 4:
                content = content[:at]
            case _:
                other = int(rng.integers(len(content) + 1))
                content = content[:at] + content[other : other + length] + content[at:]
    return content


def mutate_xml(root: ElementTree.Element, rng: np.random.Generator, count: int = 1) -> ElementTree.Element:
    """Return a copy of an XML tree with some changes of its attributes and elements."""
    root = copy.deepcopy(root)
    for _ in range(count):
        elements = list(root.iter())
        element = elements[rng.integers(len(elements))]
        other = elements[rng.integers(len(elements))]
        names = list(element.attrib)
        name = names[rng.integers(len(names))] if names else ""
        match int(rng.integers(10)):
            case 0 | 1 if names:
                element.set(name, ODD_TEXTS[rng.integers(len(ODD_TEXTS))])
            case 2 | 3 if names:
                element.set(name, _odd_number_in(element.get(name, ""), rng))
            case 4 if names:
                del element.attrib[name]
            case 5 if names and other.attrib:
                wanted = list(other.attrib)
                element.set(name, other.attrib[wanted[rng.integers(len(wanted))]])
            case 6:
                _parent(root, element).append(copy.deepcopy(element))
            case 7 if element is not root:
                _parent(root, element).remove(element)
            case 8 if element is not root and element not in other.iter() and other not in element.iter():
                _parent(root, element).remove(element)
                other.append(element)
            case _:
                element.tag = other.tag
    return root


def _odd_number_in(text: str, rng: np.random.Generator) -> str:
    """A text of numbers, one of which is another."""
    words = text.split() or [""]
    at = int(rng.integers(len(words)))
    try:
        words[at] = repr(float(words[at]) * float(rng.choice(_SCALES)))
    except ValueError:
        words[at] = ODD_TEXTS[rng.integers(len(ODD_TEXTS))]
    return " ".join(words)


def _parent(root: ElementTree.Element, element: ElementTree.Element) -> ElementTree.Element:
    return next((each for each in root.iter() if element in list(each)), root)
