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
        ("other tumbles <= 1", "unknown measure tumbles; valid: success, falls, .*velocity_error"),
        ("other falls <= 5", "0.05 or 5 %"),
        ("other falls <= nan", "nan"),
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
