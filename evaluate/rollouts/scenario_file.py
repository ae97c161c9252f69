"""Scenarios that a user wrote: `my_file.py:NAME` is a `quad_env.Scenario` of that name in that file, or several."""

import runpy
from pathlib import Path
from typing import Any

from quad_env.files.reading import TEXT, check_file
from quad_env.files.text import described
from quad_env.scenarios.combination import is_combination
from quad_env.scenarios.named import SCENARIOS, Scenario
from quad_env.serialisation import from_plain, to_plain


def from_file(reference: str) -> tuple[Scenario, ...]:
    """The scenarios that `file.py:NAME` refers to; ValueError, one line, where there are none."""
    file, _, name = reference.rpartition(":")
    contents = _run(Path(file))
    if name not in contents:
        known = [key for key, value in contents.items() if _scenarios(value)]
        raise ValueError(f"{file} has no {name!r}; its scenarios: {', '.join(known) or 'none'}")
    found = _scenarios(contents[name])
    if not found:
        raise ValueError(f"{name} in {file} must be a quad_env.Scenario or a tuple of them, not {contents[name]!r:.80}")
    for scenario in found:
        _check(scenario, file)
    return found


def _run(file: Path) -> dict[str, Any]:
    """What the file defines."""
    if not file.is_file():
        raise ValueError(f"there is no file {file}")
    try:
        check_file(file, TEXT)
        return runpy.run_path(str(file))
    except (Exception, SystemExit) as error:
        raise ValueError(f"{file} fails: {described(error)}") from error


def _scenarios(value: Any) -> tuple[Scenario, ...]:
    """The scenarios that a value is; none if it is something else."""
    several = tuple(value) if isinstance(value, list | tuple) else (value,)
    return several if all(isinstance(each, Scenario) for each in several) else ()


def _check(scenario: Scenario, file: str) -> None:
    """Raise ValueError for a scenario that a result could not hold."""
    if not isinstance(scenario.name, str) or not scenario.name:
        raise ValueError(f"a scenario in {file} needs a name, not {scenario.name!r}")
    if scenario.name in SCENARIOS or ":" in scenario.name or is_combination(scenario.name):
        raise ValueError(f"a scenario in {file} is called {scenario.name!r}, as one of quad_env's; call it differently")
    try:
        same = from_plain(to_plain(scenario)) == scenario
    except ValueError as error:
        raise ValueError(f"the scenario {scenario.name} in {file}: {error}") from error
    if not same:
        raise ValueError(f"the scenario {scenario.name} in {file} must be made of numbers and texts alone")
