"""Check of a value against the type annotations of settings.

A library for this check, typeguard, would be the 13th package that `pip install simple-quad` brings. The 12 others are
the simulator, Gymnasium, NumPy, SciPy and their requirements. A test compares this check with typeguard.
"""

from collections.abc import Mapping, Sequence
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin


def is_instance_of(value: object, annotation: Any) -> bool:
    """Return True if a value has the annotated type, as a type checker for Python sees it.

    An integer is also a float. All items of a container are checked; arrays are checked without their type parameters.

    Args:
        value: Any object.
        annotation: Class, `Any`, `None`, or `Literal`, a union, `tuple`, `list`, `dict`, `Sequence` or `Mapping` of
            these.

    Returns:
        True if the type is correct.

    Raises:
        TypeError: The annotation is of another kind.
    """
    if annotation is Any:
        return True
    origin = get_origin(annotation)
    parts = get_args(annotation)
    if origin is Literal:
        return any(type(value) is type(part) and value == part for part in parts)
    if origin in (Union, UnionType):
        return any(is_instance_of(value, part) for part in parts)
    kind = type(None) if annotation is None else origin or annotation
    if not isinstance(kind, type):
        raise TypeError(f"annotation of a setting: unknown kind, got {annotation}; valid: classes and unions of them")
    if not isinstance(value, (float, int) if kind is float else kind):
        return False
    return origin is None or _are_items_valid(value, origin, parts)


def _are_items_valid(container: Any, kind: type, parts: tuple[Any, ...]) -> bool:
    """Return True if the items of a container have the annotated types; other objects have no items.

    Args:
        container: Instance of `kind`.
        kind: Class of the annotation.
        parts: Type parameters of the annotation.

    Returns:
        True if the items are valid.

    Raises:
        TypeError: The annotation is of another container.
    """
    if kind is tuple:
        kinds = parts[:1] * len(container) if parts[-1:] == (Ellipsis,) else parts
        return len(container) == len(kinds) and all(map(is_instance_of, container, kinds))
    if kind in (list, Sequence):
        return all(is_instance_of(item, parts[0]) for item in container)
    if kind in (dict, Mapping):
        key_kind, value_kind = parts
        return all(is_instance_of(key, key_kind) for key in container) and all(
            is_instance_of(item, value_kind) for item in container.values()
        )
    if kind.__module__ in ("builtins", "collections.abc"):
        valid = "tuple, list, dict, Sequence, Mapping"
        raise TypeError(f"annotation of a setting: unknown container, got {kind}; valid: {valid}")
    return True
