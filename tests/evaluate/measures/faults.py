"""Checks of measures by hand, and faults planted into the measures, each of which must turn a check red."""

from collections.abc import Callable, Mapping, Sequence

import pytest

Check = Callable[[], None]
Plant = Callable[[pytest.MonkeyPatch], None]


def replaced(module: object, name: str, faulty: object) -> Plant:
    """A fault in the place of something of a module."""
    return lambda patch: patch.setattr(module, name, faulty)


def wrapped(module: object, name: str, faulty: Callable[..., object]) -> Plant:
    """A fault in the place of a function, which is the first argument of the fault."""
    true = getattr(module, name)
    return replaced(module, name, lambda *arguments: faulty(true, *arguments))


def checked(checks: Sequence[Check], faults: Mapping[str, tuple[Check, Plant]]) -> tuple[Check, Check]:
    """Tests that every check passes, and that every fault fails its check and every check has a fault."""

    @pytest.mark.parametrize("check", checks, ids=lambda check: check.__name__)
    def measured_by_hand(check: Check) -> None:
        check()

    @pytest.mark.parametrize("fault", faults)
    def the_fault_is_found(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
        check, plant = faults[fault]
        plant(monkeypatch)
        with pytest.raises(AssertionError):
            check()

    assert {check for check, _ in faults.values()} == set(checks)
    return measured_by_hand, the_fault_is_found
