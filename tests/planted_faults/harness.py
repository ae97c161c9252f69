"""Faults planted into the real code: each fault must make a named check fail that passes without the fault."""

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from typing import Any

import pytest

Plant = Callable[[pytest.MonkeyPatch], None]
Check = Callable[[], None]
Faults = Mapping[str, tuple[Plant, Check]]
"""Name of a fault -> function that plants the fault, and the check that must fail with it."""


def checks_of(module: Mapping[str, Any]) -> list[Check]:
    """Return the functions of a module, given by its `globals()`, with names that start with `check_`."""
    return [value for name, value in sorted(module.items()) if name.startswith("check_")]


def one_call_old(owner: type, name: str) -> Plant:
    """Return a fault: a method of an object returns the result of its previous call."""

    def plant(patch: pytest.MonkeyPatch) -> None:
        last: dict[int, Any] = {}
        true_method = getattr(owner, name)

        def stale(self: Any, *args: Any, **options: Any) -> Any:
            now = true_method(self, *args, **options)
            before = last.get(id(self), now)
            last[id(self)] = deepcopy(now)
            return before

        patch.setattr(owner, name, stale)

    return plant


def fault_tests(checks: Sequence[Check], faults: Faults) -> tuple[Callable[..., None], ...]:
    """Return three tests of these checks and faults, for pytest to find in the module of the assignment.

    Every check passes without a fault, every fault makes its check fail, and every check has a fault.
    """

    @pytest.mark.parametrize("check", checks, ids=lambda check: check.__name__.removeprefix("check_"))
    def the_code_passes(check: Check) -> None:
        check()

    @pytest.mark.parametrize("fault", faults)
    def the_fault_turns_its_check_red(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
        plant, check = faults[fault]
        plant(monkeypatch)
        with pytest.raises(AssertionError):
            check()

    def every_check_has_a_fault_that_turns_it_red() -> None:
        assert {check for _, check in faults.values()} == set(checks)

    return the_code_passes, the_fault_turns_its_check_red, every_check_has_a_fault_that_turns_it_red
