"""Effects of command-line options: an option must change a value that the test can read."""

import contextlib
import inspect
import io
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import pytest

import policies
from evaluate.commands import outputs
from quad_env.cli.command_line import parse
from tests.batches import Batch, begun

Reading = Callable[[Any], Any]


@dataclass(frozen=True)
class Effect:
    """Option of a command, and the value that a reading must have if the option is given."""

    words: str
    reading: Reading
    expected: Any
    given: str = ""
    """Other arguments that the option requires."""


@dataclass(frozen=True)
class Called:
    """Command with given arguments; it runs when a result is first requested."""

    main: Callable[[list[str]], int]
    words: list[str]
    folder: Path
    calls: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    """Arguments of each call of `policies.resolve` and of the report, which is not written since it takes long."""

    @cached_property
    def done(self) -> tuple[int, list[Batch], str]:
        """Exit code, simulated batches of robots, and printed text."""
        printed = io.StringIO()
        with begun() as found, pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(printed):
            patch.setattr(outputs, "write_report", lambda *_, **about: self._note("report", about))
            patch.setattr(policies, "resolve", self._noted(policies.resolve))
            return self.main(self.words), found, printed.getvalue()

    def _note(self, name: str, arguments: dict[str, Any]) -> None:
        self.calls.setdefault(name, []).append(arguments)

    def _noted(self, true: Callable[..., Any]) -> Callable[..., Any]:
        def noted(*args: Any, **kwargs: Any) -> Any:
            given = inspect.signature(true).bind(*args, **kwargs)
            given.apply_defaults()
            self._note(true.__name__, given.arguments)
            return true(*args, **kwargs)

        return noted

    @property
    def code(self) -> int:
        """Exit code of the command."""
        return self.done[0]

    @property
    def batches(self) -> list[Batch]:
        """Return the simulated batches of robots."""
        assert self.code in {0, 1}
        return self.done[1]

    @property
    def said(self) -> str:
        """Text that the command printed."""
        return self.done[2]

    def of(self, name: str, argument: str) -> list[Any]:
        """Return the argument `argument` of all calls of the function `name`, without repetitions."""
        assert self.code in {0, 1}
        found = [each[argument] for each in self.calls.get(name, [])]
        return [value for place, value in enumerate(found) if value not in found[:place]]


def check_other_than_usual(kind: Any, words: list[str], names: Iterable[str]) -> Any:
    """Return the options of the given arguments; check that each named option is given and differs from its default."""
    options = parse(kind, words, program="", description="")
    for each in fields(kind):
        if each.name in names:
            usual = each.default if each.default_factory is MISSING else each.default_factory()
            assert usual is MISSING or getattr(options, each.name) != usual, each.name
    return options


def check_all(effects: Mapping[str, Effect], made: Called) -> None:
    """Check the effects of options that were all given in one call."""
    assert {name: each.reading(made) for name, each in effects.items()} == {
        name: each.expected for name, each in effects.items()
    }
