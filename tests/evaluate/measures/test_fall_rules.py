"""Fall rules by hand, and `rescore`: the falls of a traced evaluation under any of them."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from evaluate.__main__ import main
from evaluate.measures import fall_rules
from evaluate.measures.episodes import blank, uneventful
from evaluate.measures.outcomes import SUCCESS_RULE
from evaluate.records.episode_table import write_parquet
from evaluate.records.store import read_run
from evaluate.statistics.intervals import wilson_interval
from quad_env.config import FALL_RULE
from quad_env.robots.simple_quad import SIMPLE_QUAD
from research.__main__ import main as research
from research.studies import rescore

STEPS = 6
UPRIGHT = {"height": 0.5, "tilt": 0.0, "trunk_contact": False, "leg_contact": False}
FALLS = {
    "sound": ({}, ()),
    "low": ({"height": 0.115}, (FALL_RULE, "height-only")),
    "crouching": ({"height": 0.13}, ("height-only",)),
    "crouching less": ({"height": 0.15}, ()),  # above 0.267 of 0.54 m, its height at home; its legs are of 0.6 m
    "leaning": ({"tilt": np.deg2rad(71)}, (FALL_RULE, "tilt-70")),
    "upside down": ({"tilt": np.deg2rad(91)}, (FALL_RULE, "tilt-70", "tilt-90")),
    "on its belly": ({"trunk_contact": True}, (FALL_RULE, "trunk-contact", "non-foot-contact")),
    "on its knees": ({"leg_contact": True}, ("non-foot-contact",)),
}


def episode(change: dict, **more):
    """Upright for two steps, then as `change` says for one, then upright again."""
    signals = {name: blank(SIMPLE_QUAD, name, STEPS, 1) for name in UPRIGHT}
    for name, signal in signals.items():
        signal[:] = UPRIGHT[name]
    for name, value in change.items():
        signals[name][2] = value
    return uneventful(SIMPLE_QUAD, STEPS, after_falls=True, **signals | more)


@pytest.mark.parametrize("name", FALLS)
def test_each_rule_sees_the_step_that_it_is_about(name) -> None:
    change, seen_by = FALLS[name]
    for rule in fall_rules.RULES.values():
        expected = 2 if rule.name in seen_by else STEPS
        assert fall_rules.first_step(rule, episode(change)).tolist() == [expected], rule.name


def test_a_divergence_is_a_fall_under_every_rule() -> None:
    record = episode({}, fall_step=np.array([4]), divergence_step=np.array([4]))
    assert {int(fall_rules.fall_step(rule, record)[0]) for rule in fall_rules.RULES.values()} == {4}


def test_unknown_rules_are_refused_with_the_valid_ones() -> None:
    assert [rule.name for rule in fall_rules.find(("all",))] == list(fall_rules.RULES)
    with pytest.raises(ValueError, match="tilt-90"):
        fall_rules.find(("tilt-91",))


@pytest.fixture(scope="module")
def traced(tmp_path_factory):
    """A small evaluation with traces, as the command leaves it."""
    folder = tmp_path_factory.mktemp("traced")
    of_what = ("--policies", "document", "stand", "--scenarios", "push", "--episodes", "6")
    assert main([*of_what, "--trace", "compact", "--no-film", "--out", str(folder)]) == 0
    return folder


def test_rescoring_under_the_runs_own_rule_gives_the_runs_numbers(traced, capsys) -> None:
    assert research(["rescore", str(traced)]) == 0
    run, again = (json.loads((traced / name).read_text(encoding="utf-8")) for name in ("results.json", rescore.FILE))
    for policy, contents in run["policies"].items():
        cell, scores = contents["scenarios"]["push"], again["policies"][policy]["scenarios"]["push"]
        for name in ("episodes", "falls", "fall_rate", "fall_rate_ci", "time_to_fall"):
            assert scores[FALL_RULE][name] == cell[name], (policy, name)
        assert list(scores) == list(again["rules"]) == list(fall_rules.RULES)
        for score in scores.values():
            assert score["fall_rate_ci"] == list(wilson_interval(score["falls"], 6))
    assert run["policies"]["document"]["scenarios"]["push"]["falls"] > 0
    for policy, contents in run["policies"].items():
        cell, scores = contents["scenarios"]["push"], again["success"]["policies"][policy]["scenarios"]["push"]
        for name in ("episodes", "successes", "success_rate", "success_rate_ci", "outcomes"):
            assert scores[SUCCESS_RULE][name] == cell[name], (policy, name)
        assert scores["survival"]["successes"] == cell["episodes"] - cell["falls"]
        assert scores["success-half"]["successes"] <= cell["successes"] <= scores["success-double"]["successes"]
    printed = capsys.readouterr().out
    assert all(word in printed for word in ("document", "stand", "push", "contact", "[61, 100]"))


def test_rules_can_be_chosen(traced, capsys) -> None:
    assert research(["rescore", str(traced), "--rules", "tilt-90"]) == 0
    assert list(json.loads((traced / rescore.FILE).read_text(encoding="utf-8"))["rules"]) == ["tilt-90"]
    assert research(["rescore", str(traced), "--rules", "tilt-90", "--success", "survival"]) == 0
    assert list(json.loads((traced / rescore.FILE).read_text(encoding="utf-8"))["success"]["rules"]) == ["survival"]
    assert "height" not in capsys.readouterr().out


def test_mistakes_are_one_line(traced, run, tmp_path, capsys) -> None:
    assert research(["rescore", str(traced), "--rules", "tilt-91"]) == 2
    assert research(["rescore", str(traced), "--success", "luck"]) == 2
    assert research(["rescore", str(run.folder)]) == 2
    other = Path(shutil.copytree(traced, tmp_path / "other"))
    there = read_run(other)
    fell = ~there.cells[0].measures.fell
    measures = replace(there.cells[0].measures, fell=fell, fall_time=np.where(fell, 1.0, np.nan))
    cells = [replace(there.cells[0], measures=measures), *there.cells[1:]]
    write_parquet(cells, other / "episodes.parquet", there.manifest.fingerprint)
    assert research(["rescore", str(other)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 4
    assert "survival" in lines.pop(1)
    assert "tilt-90" in lines[0]
    assert "--trace" in lines[1]
    assert "not of these results" in lines[2]
