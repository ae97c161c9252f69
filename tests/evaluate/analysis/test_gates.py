"""Gates: a measure against a number, the worst scenario decides, and mistakes name what is valid."""

import dataclasses

import pytest

from evaluate.analysis.gates import check, evaluate, parse

SCENARIOS = ("flat", "push:1", "push:3", "push:5", "push:6", "rough")


@pytest.mark.parametrize(
    ("text", "passed", "figure"),
    [
        ("other falls <= 55 % on rough", True, "55 % on rough"),  # 22 of 40
        ("other falls < 55 % on rough", False, "55 % on rough"),
        ("other falls<=0.55 on rough", True, "55 % on rough"),
        ("trot falls <= 90 %", False, "95 % on push:6"),
        ("trot falls <= 90 % on push:5, rough", True, "85 % on push:5"),
        ("trot success >= 5 %", True, "5.0 % on push:6"),
        ("other velocity_error < 0.1", True, "0.089 on flat"),
        ("other cost_of_transport < 100", False, "– on flat"),  # it does not exist
        ("other diverged <= 0", True, "0.000 on flat"),
    ],
)
def test_the_worst_scenario_decides_and_is_shown(made, text, passed, figure) -> None:
    result = evaluate(parse(text), made)
    assert result.passed == passed
    assert result.line.replace("\u00a0", " ") == f"{'passed' if passed else 'failed'}: {text} ({figure})"


def test_a_scenario_that_was_not_run_fails_if_it_is_named(made) -> None:
    left = {key: summary for key, summary in made.summaries.items() if key != ("rough", "other")}
    results = dataclasses.replace(made, summaries=left)
    assert evaluate(parse("other falls <= 100 %"), results).passed
    assert not evaluate(parse("other falls <= 100 % on rough"), results).passed


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("other falls", "POLICY MEASURE"),
        ("other falls <= trot", "trot is no number"),
        ("other tumbles <= 1", "unknown measure tumbles; valid: success, falls, .*velocity_error.*flight"),
        ("other falls <= 5", "0.05 or 5 %"),
        ("other falls <= nan", "nan"),
        ("other flight <= 5", "0.05 or 5 %"),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_line(text, words) -> None:
    with pytest.raises(ValueError, match=words) as error:
        parse(text)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [("nobody falls <= 1", "nobody is not among .* trot, other"), ("other falls <= 1 on ice", "ice is not among")],
)
def test_a_policy_or_scenario_that_is_not_in_the_run_is_refused(text, words) -> None:
    with pytest.raises(ValueError, match=words):
        check([parse(text)], ("trot", "other"), SCENARIOS)


@pytest.fixture
def walked(made):
    """The same, and what the other took on flat ground."""
    summary = made.summaries["flat", "other"]
    known = {"effort": summary.effort | {"flight": 0.04, "step_rate": 4.5, "cost_of_transport": 0.9}}
    return dataclasses.replace(made, summaries={("flat", "other"): dataclasses.replace(summary, **known)})


@pytest.mark.parametrize(
    ("text", "passed", "figure"),
    [
        ("other cost_of_transport <= 1.0 on flat", True, "0.900 on flat"),
        ("other flight <= 5 % on flat", True, "4.0 % on flat"),
        ("other flight <= 0.03", False, "0.040 on flat"),
        ("other step_rate < 4", False, "4.500 on flat"),
        ("other torque_share <= 100 %", False, "– on flat"),  # it does not exist
    ],
)
def test_a_figure_of_effort_is_a_measure(walked, text, passed, figure) -> None:
    result = evaluate(parse(text), walked)
    assert (result.passed, result.line.partition(f"{text} ")[2].replace("\u00a0", " ")) == (passed, f"({figure})")
