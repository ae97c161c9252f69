"""Study of the effect of each choice in the training."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.files.writing import exclusive_lock
from quad_env.scenarios.registry import scenario
from research.__main__ import main
from research.training import ablation_groups, ablation_runs, ablation_time
from research.training.ablation_groups import DEFAULT, GROUPS, Variant
from research.training.ablation_runs import StudySettings, make_config, make_runs, part_of
from research.training.ablation_tables import make_rows, student_interval
from train import validation
from train.config import DEFAULTS, RECIPES, TrainConfig
from train.distillation.config import DistillationConfig
from train.distillation.teacher import make_teacher, student_inputs
from train.run import make_env
from train.run_record import differences

SETTINGS = StudySettings(budget=None, episodes=1, threads=1, out=Path("runs"))
TINY_PPO = "--ppo.envs 8 --ppo.rollout-steps 4 --ppo.minibatch 16 --ppo.epochs 1 --mixture flat 1 --max-episode-steps 8"
TINY_DISTILLATION = (
    "--teacher trot --envs 4 --round-steps 10 --fit.hidden 4 --fit.round-updates 1 --fit.final-updates 1 "
    "--fit.minibatch 8 --mixture flat 1 --max-episode-steps 20"
)
CASES = [(name, robot) for name, group in GROUPS.items() for robot in group.robots]


def options_of(words: str) -> set[str]:
    return {word for word in words.split() if word.startswith("--")}


@pytest.mark.parametrize(("name", "robot"), CASES)
def test_variants_differ_from_the_default_in_their_options_alone(name, robot):
    group = GROUPS[name]
    default = make_config(group, robot, DEFAULT, SETTINGS)
    for variant in group.variants_of(robot):
        config = make_config(group, robot, variant, SETTINGS)
        changed = {each.option for each in differences(default, config)}
        smaller = {f"--{group.unit}"} if group.variants[variant].budget_fraction != 1.0 else set()
        given = options_of(group.variants[variant].options) | smaller
        assert changed == {option.replace("no-", "") for option in given}, variant
        assert config.validation == default.validation


@pytest.mark.parametrize(("name", "robot"), [case for case in CASES if case[0] != "distillation"])
def test_every_variant_of_ppo_can_be_trained(name, robot):
    for variant in GROUPS[name].variants_of(robot):
        config = make_config(GROUPS[name], robot, variant, SETTINGS)
        make_env(dataclasses.replace(config, ppo=dataclasses.replace(config.ppo, envs=2))).close()


def test_every_variant_of_the_distillation_has_its_own_settings():
    group = GROUPS["distillation"]
    configs = [make_config(group, "go1", variant, SETTINGS) for variant in group.variants]
    teacher = make_teacher(configs[0])
    shown = {(str(student_inputs(config, teacher)), str(config)) for config in configs}
    assert len(shown) == len(group.variants)
    assert len({student_inputs(config, teacher) for config in configs}) == 5


def test_defaults_are_those_of_the_commands():
    validation = {"--validation.interval", "--validation.episodes", "--validation.scenarios"}
    for name, config in (
        ("distillation", DistillationConfig(robot="go1")),
        ("end-to-end", RECIPES["joystick"]),
        ("residual", DEFAULTS["residual"]),
    ):
        group = GROUPS[name]
        default = make_config(group, group.robots[0], DEFAULT, SETTINGS)
        assert {each.option for each in differences(config, default)} <= validation | {"--steps"}, name
    full = make_config(GROUPS["physics"], "go1", DEFAULT, SETTINGS)
    assert isinstance(full, TrainConfig)
    robots = make_env(dataclasses.replace(full, ppo=dataclasses.replace(full.ppo, envs=2)))
    trained = robots.env.unwrapped.batches[0].simulation.model
    robots.close()
    evaluated = SimpleQuadVectorEnv(1, scenario("flat"), robot=full.hardware.robot_model).simulation.model
    for field in ("geom_contype", "dof_frictionloss"):
        np.testing.assert_array_equal(getattr(trained, field), getattr(evaluated, field))
    for field in ("timestep", "iterations", "cone"):
        assert getattr(trained.opt, field) == getattr(evaluated.opt, field)


@pytest.mark.parametrize("budget", [20_000, 250_000, 1_000_000])
def test_a_smaller_distillation_has_the_rounds_of_the_default(budget):
    settings = dataclasses.replace(SETTINGS, budget=budget)
    rounds = [make_config(GROUPS["distillation"], "go1", name, settings).rounds for name in (DEFAULT, "no clock")]
    assert rounds == pytest.approx([DistillationConfig().rounds] * 2, abs=4)
    quarter = make_config(GROUPS["distillation"], "go1", "a quarter of the labels", settings)
    assert quarter.labels == budget // 4


def test_parts_share_all_runs():
    runs = make_runs("distillation", "go1", (DEFAULT, "no clock", "no history"), 5, SETTINGS)
    assert len({run.config.folder for run in runs}) == 15
    assert [run.config.seed for run in runs[::3]] == [0, 1, 2, 3, 4]
    parts = [part_of(runs, f"{index}/4") for index in range(1, 5)]
    assert sorted(str(run) for part in parts for run in part) == sorted(map(str, runs))
    assert max(map(len, parts)) - min(map(len, parts)) <= 1


def results(success, error):
    return {"success": success, "velocity_error": error, "minutes": 2.0}


def test_the_rows_by_hand():
    """Differences of 8, 10 and 12 points: the mean is 10, the std 2, so the interval is 10 ± 4.303 · 2 / √3."""
    variants = {
        DEFAULT: [results(success, 0.1) for success in (10.0, 50.0, 30.0)],
        "no memory": [results(success, 0.3) for success in (18.0, 60.0, 42.0)],
    }
    first, second = make_rows(GROUPS["residual"], "go1", variants)
    assert (first["success"], first["success_by_seed"]) == (30.0, "10 50 30")
    assert "success_difference" not in first
    assert 0.0 < first["success_low"] < 10.0
    assert 50.0 < first["success_high"] < 100.0
    half = 4.303 * 2.0 / np.sqrt(3.0)
    difference = [second[f"success_difference{end}"] for end in ("", "_low", "_high")]
    assert difference == pytest.approx([10.0, 10.0 - half, 10.0 + half], abs=0.001)
    assert second["velocity_error_difference"] == pytest.approx(0.2)
    assert np.isnan(second["velocity_error_low"])
    assert np.isnan(student_interval(np.array([1.0, 1.0]))).all()


@pytest.fixture
def study(tmp_path, monkeypatch):
    """Return a function that runs the command on two tiny groups of two variants, and the folder of its files."""
    true_run = validation.run
    monkeypatch.setattr(validation, "run", lambda *args, **kwargs: true_run(*args, **kwargs | {"steps": 110}))
    for name, tiny, option in (("residual", TINY_PPO, "--ppo.hold 3"), ("distillation", TINY_DISTILLATION, "")):
        variants = {DEFAULT: Variant(), "other": Variant(option, 1.0 if option else 0.5)}
        group = dataclasses.replace(
            GROUPS[name], options=tiny, variants=variants, scenarios=("flat",), flat="flat", robots=("simple_quad",)
        )
        monkeypatch.setitem(ablation_groups.GROUPS, name, group)
    page = tmp_path / "page.md"
    page.write_text(
        "above\n<!-- residual -->\n<!-- /residual -->\n<!-- distillation -->\n<!-- /distillation -->\nbelow"
    )
    words = ["ablations", "--groups", "distillation", "residual", "--labels", "320", "--steps", "64", "--seeds", "2"]
    words += ["--episodes", "1", "--out", str(tmp_path / "runs"), "--page", str(page), "--tables", str(tmp_path)]
    return lambda *more: main([*words, *more]), tmp_path


def trained(folder):
    return {path: path.stat().st_mtime_ns for path in folder.rglob("policy.safetensors")}


def test_parts_train_each_run_once_and_the_last_part_writes_page_tables_and_figures(study, capsys):
    run, folder = study
    assert run("--part", "1/2") == 0
    assert "no table yet, because 2 of 4 runs are not finished" in capsys.readouterr().out
    assert not list(folder.glob("*.csv"))
    first = trained(folder)
    assert run("--part", "2/2") == 0
    assert first.items() <= trained(folder).items()
    assert len({path.parents[1] for path in trained(folder)}) == 8
    page = (folder / "page.md").read_text(encoding="utf-8")
    assert page.startswith("above")
    assert page.endswith("below")
    assert page.count("| other |") == 2
    assert "](ablations_residual_simple_quad.png)" in page
    assert "`--labels x 0.5`" in page
    assert "--groups distillation --labels 320" in page
    assert (folder / "ablations_residual_simple_quad.png").read_bytes().startswith(b"\x89PNG")
    assert "other,--ppo.hold 3," in (folder / "ablations_residual.csv").read_text(encoding="utf-8")
    everything = trained(folder)
    assert run() == 0
    assert trained(folder) == everything
    assert (folder / "page.md").read_text(encoding="utf-8") == page
    capsys.readouterr()
    assert run("--steps", "128") == 2
    assert "holds a run of other settings" in capsys.readouterr().err


def test_a_run_that_another_process_trains_is_left_out(study, capsys):
    run, folder = study
    busy = folder / "runs/distillation/simple_quad/default/seed-0"
    busy.mkdir(parents=True)
    with exclusive_lock(busy):
        assert run("--groups", "distillation") == 0
    printed = capsys.readouterr().out
    assert "another process trains this run: left out" in printed
    assert "1 of 4 runs are not finished, for example distillation, simple_quad, default, seed 0" in printed
    assert len({path.parents[1] for path in trained(folder)}) == 3


def test_a_dry_run_trains_nothing_and_prints_processor_times(study, capsys, monkeypatch):
    run, folder = study
    monkeypatch.setattr(ablation_time, "PILOT_UPDATES", 1)
    monkeypatch.setattr(ablation_time, "PILOT_EPISODES", 1)
    assert run("--dry-run", "--labels", "32000000", "--steps", "64000000") == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[0] for line in lines[:2]] == ["distillation, simple_quad", "residual, simple_quad"]
    assert all("0 of 4 runs finished" in line for line in lines[:2])
    hours = [float(line.split(", ")[-1].split()[0]) for line in lines[:2]]
    assert min(hours) > 0.0
    assert float(lines[2].split()[1]) == pytest.approx(sum(hours), abs=0.02)
    assert not (folder / "runs").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--groups residuals", "--groups: unknown 'residuals'; valid: 'distillation', 'end-to-end'"),
        ("--groups residual residual", "--groups: a name is given twice, got residual residual"),
        ("--variants no-clock", "--variants: unknown 'no-clock'; valid: 'default'"),
        ("--part 3/2", "--part: no K/N with K from 1 to N, got 3/2"),
        ("--part x", "--part: no K/N with K from 1 to N, got x"),
        ("--labels 60", "--labels: 'other' has 30 labels, fewer than the 40 of a round, got 60; valid: from about 80"),
        ("--page missing.md", "cannot read the page missing.md"),
    ],
)
def test_a_wrong_option_gets_one_line(words, message, study, capsys):
    run, _ = study
    assert run(*words.split()) == 2
    error = capsys.readouterr().err
    assert message in error
    assert len(error.splitlines()) == 1


def test_results_are_those_of_the_last_validation(tmp_path, monkeypatch):
    run = make_runs("end-to-end", "go1", (DEFAULT,), 1, dataclasses.replace(SETTINGS, out=tmp_path))[0]
    run.config.folder.mkdir(parents=True)
    (run.config.folder / "validations.json").write_text(
        '{"validations": [{"success": 0.1, "scenarios": {}}, '
        '{"success": 0.25, "scenarios": {"flat": {"velocity_error": 0.5}, "push": {"velocity_error": 0.7}}}]}'
    )
    (run.config.folder / "metrics.jsonl").write_text('{"time/seconds": 1}\n{"time/seconds": 90}\n')
    assert ablation_runs.read_results(run) == {"success": 25.0, "velocity_error": 0.5, "minutes": 1.5}
