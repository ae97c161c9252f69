"""Values are checked against annotations as typeguard, an independent type checker, checks them."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal, Optional

import numpy as np
import pytest
from numpy.typing import NDArray
from typeguard import CollectionCheckStrategy, TypeCheckError, check_type

import policies.description
import quad_env
from policies.external import spec
from quad_env.config import Settings, _annotations
from quad_env.type_check import is_instance_of

VALUES = (
    0, 1, -1.5, float("nan"), True, None, "all", "feet", "", 2j, b"all", np.float64(1.0), np.float32(1.0), np.int64(1),
    (), (1,), (1.0, 2), (1.0, "2"), (1, 2, 3), ("a", "b"), [], [1.0, 2.0], ["a"], {}, {"a": 1.0}, {1: "a"},
    np.zeros(3), np.zeros(3, dtype=bool), quad_env.Slope(), quad_env.Pushes(), quad_env.TaskConfig(), float, object(),
)  # fmt: skip
OTHERS = [
    Any, None, type(None), list[float], list[tuple[int, ...]], dict[str, float], dict[str, Any], Optional[str],  # noqa: UP045
    Literal[1, "all"], tuple[()], tuple[float, str], tuple[str | None, ...], NDArray[np.float64], float | NDArray[Any],
    tuple[tuple[float, ...], ...], list, dict, tuple, object, Sequence[str], Sequence[float], Sequence,
    Mapping[str, float], Mapping,
]  # fmt: skip


def subclasses(kind: type) -> set[type]:
    return {kind, *(each for child in kind.__subclasses__() for each in subclasses(child))}


def annotations() -> list[Any]:
    """Return the annotations of all settings of the project, and others."""
    assert policies.description
    checked = subclasses(Settings) | subclasses(spec._CheckedSpec)
    found = {str(kind): kind for each in checked for kind, _ in _annotations(each).values()}
    # The workers of pytest-xdist must see the same order; that of the sets of classes differs from process to process.
    return [*(found[name] for name in sorted(found)), *OTHERS]


def is_valid(value: object, kind: Any) -> bool:
    try:
        check_type(value, kind, collection_check_strategy=CollectionCheckStrategy.ALL_ITEMS)
    except TypeCheckError:
        return False
    return True


@pytest.mark.parametrize("kind", annotations(), ids=str)
def test_a_value_is_valid_where_typeguard_says_so(kind: Any) -> None:
    expected = [is_valid(value, kind) for value in VALUES]
    assert [is_instance_of(value, kind) for value in VALUES] == expected


def test_an_annotation_of_another_kind_is_refused() -> None:
    with pytest.raises(TypeError, match="unknown kind, got word; valid"):
        is_instance_of(1, "word")
    with pytest.raises(TypeError, match=r"unknown container, got .*set.*; valid: tuple, list"):
        is_instance_of({1}, set[int])
