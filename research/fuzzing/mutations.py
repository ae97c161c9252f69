"""Functions that randomly change the content of a valid file: nested values, XML elements, or bytes.

The fuzz test reads the changed files, to find faults in the functions that read users' files.
"""

import copy
import math
from typing import Any
from xml.etree import ElementTree

import numpy as np

Tree = Any
"""Type of the content of a settings file: nested dictionaries and lists with texts, numbers and None."""
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
"""Unusual values, for example NaN or an empty list, that replace valid values in a settings file."""
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
"""Unusual texts, for example `nan` or an empty text, that replace valid values of XML attributes."""
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
"""Unusual byte sequences, for example a null byte, that are inserted into a file at random positions."""
_SCALES = (0.0, -1.0, 0.1, 10.0, 1e3, 1e6, 1e12)
"""Factors, dimensionless; a random change of a number multiplies the number by one of these factors."""


def list_entries(tree: Tree) -> list[tuple[Any, Any]]:
    """List all values in a tree of dictionaries and lists, so that each can be changed in place.

    Args:
        tree: Nested dictionaries and lists.

    Returns:
        For each value: the dictionary or list that contains the value, and its key or index there.
    """
    entries = []
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        keys = list(node) if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ()
        for key in keys:
            entries.append((node, key))
            waiting.append(node[key])
    return entries


def mutate_tree(tree: Tree, rng: np.random.Generator, count: int = 1) -> Tree:
    """Return a copy of nested settings, in which random values or keys are changed, removed or repeated.

    Args:
        tree: Settings: nested dictionaries and lists with valid values.
        rng: Random generator.
        count: Number of changes.

    Returns:
        The changed copy.
    """
    tree = copy.deepcopy(tree)
    for _ in range(count):
        entries = list_entries(tree)
        if not entries:
            return tree
        holder, key = entries[rng.integers(len(entries))]
        value = holder[key]
        match int(rng.integers(9)):
            case 0 | 1:
                holder[key] = copy.deepcopy(ODD_VALUES[rng.integers(len(ODD_VALUES))])
            case 2:
                del holder[key]
            case 3:
                other_holder, other_key = entries[rng.integers(len(entries))]
                holder[key] = copy.deepcopy(other_holder[other_key])
            case 4:
                holder[key] = [value]
            case 5 if isinstance(holder, dict):
                holder[f"{key}x" if rng.integers(2) else ""] = holder.pop(key)
            case 6 if isinstance(value, list) and value:
                order = rng.permutation(len(value)).tolist()
                holder[key] = [value[index] for index in order]
            case 7 if isinstance(value, list) and value:
                holder[key] = value * int(rng.choice([2, 100, 10_000]))
            case _:
                if isinstance(value, int | float) and not isinstance(value, bool):
                    holder[key] = float(min(max(value, -1e300), 1e300)) * float(rng.choice(_SCALES))
    return tree


def mutate_bytes(content: bytes, rng: np.random.Generator, count: int = 1) -> bytes:
    """Return a copy of a file's content in which random bytes are changed, removed, inserted or repeated.

    Args:
        content: Valid content of a file.
        rng: Random generator.
        count: Number of changes.

    Returns:
        The changed bytes.
    """
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
    """Return a copy of an XML tree with random changes of its attributes and elements.

    Args:
        root: Root element of a valid XML tree.
        rng: Random generator.
        count: Number of changes.

    Returns:
        The changed copy.
    """
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
                element.set(name, _with_odd_number(element.get(name, ""), rng))
            case 4 if names:
                del element.attrib[name]
            case 5 if names and other.attrib:
                other_names = list(other.attrib)
                element.set(name, other.attrib[other_names[rng.integers(len(other_names))]])
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


def _with_odd_number(text: str, rng: np.random.Generator) -> str:
    """Change one random number in a text of numbers separated by spaces, as in an XML attribute.

    Args:
        text: Numbers as text.
        rng: Random generator.

    Returns:
        The changed text. The number is multiplied by a random factor. A word that is not a number is replaced by an
        unusual text, for example `nan` (see ODD_TEXTS).
    """
    words = text.split() or [""]
    index = int(rng.integers(len(words)))
    try:
        words[index] = repr(float(words[index]) * float(rng.choice(_SCALES)))
    except ValueError:
        words[index] = ODD_TEXTS[rng.integers(len(ODD_TEXTS))]
    return " ".join(words)


def _parent(root: ElementTree.Element, element: ElementTree.Element) -> ElementTree.Element:
    """Return the parent of an XML element in the tree of `root`; the root is its own parent."""
    return next((candidate for candidate in root.iter() if element in list(candidate)), root)
