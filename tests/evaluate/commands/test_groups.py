"""Groups of training seeds: `--policies NAME=PATTERN`, one entry of all seeds in results, tables and the terminal."""

import json
import shutil
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import scipy.stats

from evaluate.__main__ import main
from evaluate.analysis.results import analyse
from evaluate.commands.groups import expand_patterns, split_groups
from evaluate.report.sections.seed_groups import render_seed_groups
from evaluate.statistics.intervals import wilson_interval
from quad_env.cli.command_line import UsageError
from quad_env.cli.format import points_with
from tests.evaluate.conftest import fallen
from tests.seams import short_episodes, without_report

SEEDS = ("seed-0", "seed-2", "seed-10")


@pytest.fixture
def trained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the working folder, with three folders of a trained policy."""
    for seed in SEEDS:
        shutil.copytree(Path(__file__).parents[3] / "models/residual", tmp_path / "runs" / seed)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_pattern_names_each_matching_folder_in_the_order_of_its_numbers(trained: Path) -> None:
    (word, other) = expand_patterns(("mine=runs/seed-*", "trot"))
    assert word == "mine=runs/seed-0,runs/seed-2,runs/seed-10"
    assert other == "trot"
    assert expand_patterns((word,)) == (word,)
    members = tuple(f"runs/{seed}" for seed in SEEDS)
    assert split_groups((word, other)) == ((*members, "trot"), {"mine": members})


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ("mine=runs/none-*", "--policies: group mine: no file or folder matches, got runs/none-*"),
        ("mine=runs/seed-0", "--policies: group mine has one training seed, got runs/seed-0; valid: 2 or more"),
        ("mine=runs/seed-* mine=stand,trot", "--policies: group mine given more than once"),
        ("trot=runs/seed-* trot", "--policies: trot is a group and a policy; valid: another name for the group"),
        ("mine=runs/seed-* runs/seed-0", "--policies: runs/seed-0 given more than once"),
    ],
)
def test_bad_groups_are_one_line(trained, capsys, words, complaint, no_simulation) -> None:
    assert main(["--policies", *words.split(), "--scenarios", "flat", "--out", "out"]) == 2
    assert complaint in capsys.readouterr().err.splitlines()[-1]


def test_a_name_with_an_equals_sign_that_exists_is_a_policy(trained: Path) -> None:
    (trained / "a=b").mkdir()
    assert split_groups(expand_patterns(("a=b",))) == (("a=b",), {})


def test_one_seed_of_three_fails_and_the_group_has_their_mean_with_a_wider_interval() -> None:
    falls = {"mine/0": 0, "mine/1": 4, "mine/2": 30, "trot": 2}
    cells = [
        fallen(policy, scenario, count, np.full(40, 0.1))
        for scenario in ("push:1", "push:3")
        for policy, count in falls.items()
    ]
    groups = {"mine": ["mine/0", "mine/1", "mine/2"]}
    results = analyse(cells, seed=0, episodes=40, complete=True, provenance={"versions": {}, "groups": groups})
    (group,) = results.groups
    rate = group.scenarios["push:3"]
    assert (rate.episodes, rate.success_rate) == (120, pytest.approx(1 - 34 / 120))
    low, high = rate.success_rate_ci
    pooled = wilson_interval(86, 120)
    assert low < pooled[0]
    assert high > pooled[1]
    assert group.score is not None
    assert group.hardware_score is None
    assert group.score.score == pytest.approx(np.mean([s.score for s in results.scores if s.policy != "trot"]))
    rates = [cell.measures.succeeded.mean() for cell in cells if cell.policy != "trot"]
    assert group.score.interquartile_mean == pytest.approx(scipy.stats.trim_mean(rates, 0.25))
    assert group.score.ci[1] - group.score.ci[0] > 0.5
    section = render_seed_groups(results)
    assert "<h2>Training seeds</h2>" in section
    assert points_with(group.score.score, group.score.ci).value in section
    assert points_with(group.score.interquartile_mean, group.score.interquartile_mean_ci).value in section
    assert "hardware" not in section


def test_the_command_simulates_each_seed_and_writes_one_entry_for_the_group(tmp_path, monkeypatch, capsys) -> None:
    short_episodes(monkeypatch, 130)
    without_report(monkeypatch)
    words = ["--policies", "walkers=trot,crouch", "stand", "--scenarios", "flat", "push:2", "--episodes", "3"]
    assert main([*words, "--threads", "1", "--out", str(tmp_path / "run")]) == 0
    printed = capsys.readouterr().out
    results = json.loads((tmp_path / "run/results.json").read_text(encoding="utf-8"))
    assert set(pq.read_table(tmp_path / "run/episodes.parquet")["policy"].to_pylist()) == {"stand", "crouch", "trot"}
    (group,) = results["groups"]
    assert (group["name"], group["policies"]) == ("walkers", ["trot", "crouch"])
    (line,) = (line for line in printed.splitlines() if "walkers" in line)
    assert "2 seeds" in line
    score = group["score"]["score"]
    assert f"{100 * score:.0f}" in line


def test_a_group_without_policies_is_refused() -> None:
    with pytest.raises(UsageError):
        expand_patterns(("mine=runs/none-*",))
