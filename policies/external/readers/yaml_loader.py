"""YAML loader for files of other projects: it never runs code in a file, and limits sizes.

The loader follows YAML 1.1 with three restrictions. Dates, digit groups (`1_000`) and numbers of base sixty (`1:30`)
remain texts. Duplicate keys, lists or mappings as keys, and mappings of more than MAX_PAIRS keys are errors. Tags of
Python objects run no code: only tuples and slices are accepted.
"""

import re
from collections.abc import Callable, Hashable
from typing import Any

from policies.base import PolicyError
from policies.external.packages import import_package
from quad_env.files.text import brief

MAX_PAIRS = 20_000
"""Maximum number of keys of a mapping in a YAML file, including merged keys (`<<`)."""
MAX_DIGITS = 100
"""Maximum number of characters of a number in a YAML file."""
DECIMAL_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
"""Pattern of a finite decimal number as text, such as `-1.5e3`."""
_PYTHON_TAG = "tag:yaml.org,2002:python/"
"""Start of the YAML tags of Python objects, such as tuples."""
_INTEGER = re.compile(r"[-+]?(?:0b[01]+|0[0-7]+|0x[0-9a-fA-F]+|0|[1-9][0-9]*)$")
"""Pattern of the integers of YAML 1.1 that the loader accepts: binary, octal, decimal and hexadecimal."""
_FLOAT = re.compile(
    r"[-+]?(?:[0-9]+\.[0-9]*(?:[eE][-+][0-9]+)?|\.[0-9]+(?:[eE][-+][0-9]+)?|\.(?:inf|Inf|INF))$|\.(?:nan|NaN|NAN)$"
)
"""Pattern of the floats of YAML 1.1 that the loader accepts, including `.inf` and `.nan`."""


def parse_yaml(text: str) -> Any:
    """Parse a YAML text from a file of another project.

    Args:
        text: Content of the YAML file.

    Returns:
        Value of the YAML document: nested lists, dictionaries and scalars.

    Raises:
        ValueError: The text is not valid YAML, or exceeds a limit.
    """
    yaml = import_package("yaml")
    base: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    members = {
        "yaml_implicit_resolvers": _resolvers(base),
        "construct_mapping": _construct_mapping,
        "flatten_mapping": lambda loader, node: _flatten_mapping(loader, base, node),
        "own_keys": dict[int, set[int]](),
    }
    loader: Any = type("Loader", (base,), members)
    loader.add_multi_constructor(_PYTHON_TAG, _construct_python)
    scalars: dict[str, Callable[[str], Any]] = {"timestamp": str, "int": _parse_integer, "float": _parse_float}
    for kind, parse in scalars.items():
        loader.add_constructor(f"tag:yaml.org,2002:{kind}", _scalar_constructor(parse))
    try:
        return yaml.load(text, loader)
    except yaml.YAMLError as error:
        raise ValueError(str(error)) from None


def _resolvers(base: Any) -> dict[Any, list[tuple[str, Any]]]:
    """Return the resolvers with which the YAML loader recognises the type of a scalar.

    The result is a dictionary: first character of the scalar -> pairs of tag (type) and pattern. It is the dictionary
    of the loader class `base` with two changes: numbers must match `_INTEGER` or `_FLOAT`, and dates are not
    recognised.
    """
    patterns = {"tag:yaml.org,2002:int": _INTEGER, "tag:yaml.org,2002:float": _FLOAT}
    return {
        first: [(tag, patterns.get(tag, pattern)) for tag, pattern in rules if tag != "tag:yaml.org,2002:timestamp"]
        for first, rules in base.yaml_implicit_resolvers.items()
    }


def _scalar_constructor(parse: Callable[[str], Any]) -> Callable[[Any, Any], Any]:
    return lambda loader, node: parse(loader.construct_scalar(node))


def _parse_integer(text: str) -> int:
    """Convert the text of a YAML 1.1 integer to a number.

    Raises ValueError if the text is no integer or has more than MAX_DIGITS characters.
    """
    if len(text) > MAX_DIGITS or not _INTEGER.match(text):
        raise ValueError(f"{brief(text)} is no whole number")
    sign = -1 if text[0] == "-" else 1
    digits = text[1:] if text[0] == "-" else text.lstrip("+")
    if digits[:2] in ("0b", "0x"):
        return sign * int(digits, 0)
    return sign * int(digits, 8 if digits[0] == "0" else 10)


def _parse_float(text: str) -> float:
    """Convert the text of a YAML 1.1 float to a number. Raises ValueError if the text is no float."""
    plain = text.lower().replace(".inf", "inf").replace(".nan", "nan")
    if plain.lstrip("+-") in ("inf", "nan") or DECIMAL_NUMBER.fullmatch(plain):
        return float(plain)
    raise ValueError(f"{brief(text)} is no number")


def _flatten_mapping(loader: Any, base: Any, node: Any) -> None:
    """Insert the keys that a YAML mapping merges from other mappings (`<<`) before its own keys.

    The mapping's own keys are recorded in `loader.own_keys`, because only they are checked for duplicates. Raises
    ValueError if the mapping then has more than MAX_PAIRS keys.
    """
    loader.own_keys.setdefault(id(node), {id(key) for key, _ in node.value})
    base.flatten_mapping(loader, node)
    if len(node.value) > MAX_PAIRS:
        raise ValueError(f"line {node.start_mark.line + 1} merges more than {MAX_PAIRS} keys")


def _construct_mapping(loader: Any, node: Any, deep: bool = False) -> dict[Any, Any]:
    """Convert a mapping node of the YAML parser to a dictionary.

    Raises ValueError if the mapping contains one of its own (not merged) keys twice, or if a key is a list or mapping.
    """
    if not isinstance(node, import_package("yaml").MappingNode):
        raise ValueError(f"line {node.start_mark.line + 1} holds no settings by key")
    loader.flatten_mapping(node)
    mapping: dict[Any, Any] = {}
    own_keys = set[Any]()
    for key_node, value_node in node.value:
        key = loader.construct_object(key_node, deep=True)
        line = key_node.start_mark.line + 1
        if not isinstance(key, Hashable):
            raise ValueError(f"line {line} has a collection as a key")
        if id(key_node) in loader.own_keys[id(node)]:
            if key in own_keys:
                raise ValueError(f"line {line}: {brief(key)} is given twice")
            own_keys.add(key)
        mapping[key] = loader.construct_object(value_node, deep=deep)
    return mapping


def _construct_python(loader: Any, kind: str, node: Any) -> Any:
    """Convert a YAML node with a Python tag: a tuple becomes a list, and a slice becomes None.

    `kind` is the part of the tag after `python/`. Raises PolicyError for all other kinds, and never runs their code.
    """
    if kind == "tuple":
        return loader.construct_sequence(node, deep=True)
    if kind == "object/apply:builtins.slice":
        return None
    line = node.start_mark.line + 1
    raise PolicyError(f"line {line} has the unsupported tag !!python/{kind}", "write the value itself")
