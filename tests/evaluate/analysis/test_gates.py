"""Gates: what they mean, what they fail on, and that mistakes name what is valid."""

from xml.etree import ElementTree

import pytest

from evaluate.analysis.gate_verdicts import judge, passed
from evaluate.analysis.gates import DEFAULT, check, parse
from evaluate.report import junit

SCENARIOS = ("flat", "push:1", "push:3", "push:5", "push:6", "rough")


def failed(made, text: str) -> list[str]:
    """Scenarios on which the gate fails."""
    return [verdict.scenario for verdict in judge([parse(text)], made) if not verdict.passed]


@pytest.mark.parametrize(
    ("text", "failing"),
    [
        ("other falls <= trot", ["rough"]),  # shown to fall more there: 22 against 2 of 40
        ("trot falls <= other", ["push:3", "push:5", "push:6"]),
        ("other falls < trot", ["flat", "push:1", "rough"]),  # less is shown on two alone
        ("trot falls >= other", ["rough"]),
        ("trot falls > other", ["flat", "push:1", "rough"]),
        ("other falls <= trot strictly", ["rough"]),
        ("other falls < trot strictly", ["flat", "push:1", "rough"]),
        ("other falls <= trot on push:all", []),
        ("other falls <= trot on flat, rough", ["rough"]),
        ("other falls <= 55 % on rough", []),
        ("other falls < 55 % on rough", ["rough"]),
        ("other falls<=0.55 on rough", []),
        ("other falls <= 60 % on rough strictly", ["rough"]),  # upper end of its interval: 69 %
        ("other velocity_error < 0.1", []),
        ("trot velocity_error < 0.1", list(SCENARIOS)),
        ("other cost_of_transport < 100", list(SCENARIOS)),  # it does not exist
        ("other diverged <= 0", []),
    ],
)
def test_a_gate_fails_where_its_sentence_is_not_so(made, text, failing) -> None:
    assert failed(made, text) == failing


def test_without_a_shown_difference_nobody_is_worse_but_strictly_one_is(made) -> None:
    """One fall of forty more is no evidence; a team may still forbid it."""
    from evaluate.analysis.results import analyse

    cells = [_cell(made, "trot", 3), _cell(made, "other", 4)]
    results = analyse(cells, seed=0, episodes=40, complete=True)
    assert failed(results, "other falls <= trot") == []
    assert failed(results, "other falls <= trot strictly") == ["flat"]


def _cell(made, policy: str, count: int):
    import dataclasses

    import numpy as np

    cell = next(cell for cell in made.cells if (cell.policy, cell.scenario.name) == (policy, "flat"))
    return dataclasses.replace(cell, measures=dataclasses.replace(cell.measures, fell=np.arange(40) < count))


def test_a_reason_has_the_figures(made) -> None:
    (verdict,) = judge([parse("other falls <= trot on rough")], made)
    assert verdict.reason.replace("\u00a0", " ") == "55 % against 5.0 % of trot, p < 0.001: more is shown"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "POLICY MEASURE"),
        ("other falls", "POLICY MEASURE"),
        ("other falls == trot", "POLICY MEASURE"),
        ("other tumbles <= trot", "unknown measure tumbles; valid: success, falls, .*velocity_error"),
        ("other energy <= trot", "energy is compared with numbers only; with a policy: success, falls, velocity_error"),
        ("other falls <= 5", "0.05 or 5 %"),
        ("other falls <= nan", "0.05 or 5 %"),
        ("other falls <= x %", "no number"),
        ("other falls <= trot on", "POLICY MEASURE"),
    ],
)
def test_what_cannot_be_read_is_refused_with_what_is_valid(text, words) -> None:
    with pytest.raises(ValueError, match=words) as error:
        parse(text)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("nobody falls <= trot", "nobody is not among the policies trot, other"),
        ("other falls <= nobody", "nobody is not among the policies"),
        ("other falls <= other", "with itself"),
        ("other falls <= trot on ice", "ice is not among the scenarios flat, push:1"),
        ("other falls <= trot on ice:all", "ice:all"),
        ("default", "residual is not among"),
    ],
)
def test_what_took_no_part_is_refused(made, text, words) -> None:
    with pytest.raises(ValueError, match=words):
        judge([parse(text)], made)


def test_the_default_is_its_rules() -> None:
    assert [rule.text for rule in parse("default")] == list(DEFAULT)
    check([parse("default")], ("trot", "residual"), [("flat", "flat")])


def test_a_cell_that_was_not_run_fails(made) -> None:
    import dataclasses

    left = {key: summary for key, summary in made.summaries.items() if key != ("rough", "other")}
    results = dataclasses.replace(made, summaries=left)
    (verdict,) = judge([parse("other falls <= trot on rough")], results)
    assert not verdict.passed
    assert "did not run" in verdict.reason


def test_junit_counts_a_case_for_each_gate_and_scenario(made) -> None:
    verdicts = judge([parse("other falls <= trot"), parse("trot velocity_error < 1 on flat")], made)
    assert not passed(verdicts)
    root = ElementTree.fromstring(junit.render(verdicts))
    assert root.attrib == {"name": "simple-quad", "tests": "7", "failures": "1", "errors": "0"}
    assert [suite.get("name") for suite in root] == ["other falls <= trot", "trot velocity_error < 1 on flat"]
    failures = root.findall("./testsuite/testcase[failure]")
    assert [case.get("name") for case in failures] == ["rough"]
    assert "55" in failures[0].find("failure").get("message")
