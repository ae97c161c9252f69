"""A run with --sighted: its defaults, its files, its continuation to the bit, its policy in use, and its messages."""

import json
import shlex
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import policies
from evaluate.rollouts import rollout
from quad_env import HeightScan
from quad_env.robots.registry import get_robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.axes import axes_of
from quad_env.scenarios.registry import scenario
from quad_env.scenarios.scenario import HARDWARE
from tests.robot_models import NEEDS_MODELS
from tests.train.distillation.stopped_runs import assert_same_policies, stop_at_round
from train.__main__ import main
from train.commands import distil, run
from train.config import CONTROL_PERIOD, IMPROVE_MIXTURE
from train.curriculum import MIN_UNFINISHED_TIME
from train.distillation import config as settings
from train.distillation.run import MIN_INTERVALS
from train.run_folder import BEST
from train.run_record import load_config
from train.training_robots import distribute_robots

SCAN = HeightScan(ahead=2, behind=1, aside=1, spacing=0.15, noise=0.02, delay=0.02)
COMMON = (
    "--labels 1200 --envs 10 --round-steps 20 --segment-rounds 2 --max-episode-steps 30 --threads 1 "
    "--mixture flat 0.5 rough+scan_dropouts 0.5 --inputs.lags 0.02 --inputs.averages 0.5 --fit.hidden 8 "
    "--fit.round-updates 4 --fit.final-updates 4 --fit.minibatch 32 --validation.episodes 1 --validation.scenarios "
    "flat --validation.interval 400"
)
SCAN_OPTIONS = "--scan.ahead 2 --scan.behind 1 --scan.aside 1 --scan.spacing 0.15 --scan.noise 0.02 --scan.delay 0.02"
SIGHTED = "--teacher mpc_wbc_sighted --sighted"
WORDS = [*f"{SIGHTED} {SCAN_OPTIONS} {COMMON}".split()]


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a finished run."""
    folder = tmp_path_factory.mktemp("runs") / "whole"
    assert main([*WORDS, "--out", str(folder)]) == 0
    return folder


def test_the_bundle_names_its_scan_and_is_called_sighted(finished: Path) -> None:
    policy = policies.load(finished)
    assert (policy.name, policy.height_scan, policy.base.name) == ("sighted", SCAN, "stand")
    training = json.loads((finished / BEST / "policy.json").read_bytes())["training"]
    assert (training["teacher"], training["sighted"], training["scan"]["noise"]) == ("mpc_wbc_sighted", True, 0.02)


def test_the_policy_walks_in_the_evaluator_and_in_a_loop_of_five_lines_alike(finished: Path) -> None:
    policy = policies.load(finished)
    env = gym.make("SimpleQuad-v0", robot=policy.robot, height_scan=policy.height_scan, scenario="rough=0.24")
    observation, _ = env.reset(seed=5)
    policy.reset(num_envs=1)
    for _ in range(20):
        observation, *_ = env.step(policy.act(observation))
    evaluated = policies.load(finished)
    steps: list[np.ndarray] = []
    rollout.roll_out(
        evaluated, "rough=0.24", np.array([5]), lambda step: steps.append(step.observation[0].copy()), steps=20
    )
    np.testing.assert_array_equal(steps[20], observation)
    assert np.ptp(observation[policy.robot.num_joints * 3 + 12 :]) > 0.0


@pytest.mark.parametrize("stop_after", [2, 3])
def test_a_stopped_run_continues_to_the_same_bits(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stop_after: int
) -> None:
    folder = tmp_path / "stopped"
    with monkeypatch.context() as patch:
        stop_at_round(patch, stop_after)
        assert main([*WORDS, "--out", str(folder)]) == 130
    repeated = WORDS if stop_after == 3 else []
    assert main([*repeated, "--resume", "--out", str(folder)]) == 0
    assert_same_policies(folder, finished)


def test_the_recorded_command_repeats_the_settings(finished: Path) -> None:
    command = json.loads((finished / "run.json").read_bytes())["command"]
    assert " --sighted " in command
    assert "--sighted True" not in command
    words = shlex.split(command)[3:]
    assert distil.parse([*words, "--threads", "1"]) == distil.parse(WORDS)


def test_a_sighted_student_has_its_own_defaults_which_options_change() -> None:
    config = distil.parse(SIGHTED.split())
    assert config.mixture == settings.SIGHTED_MIXTURE
    assert config.validation.scenarios == settings.SIGHTED_VALIDATION_SCENARIOS
    assert (config.labels, config.folder.name) == (settings.SIGHTED_LABELS, "simple_quad-sighted-0")
    assert config.height_scan == settings.STUDENT_SCAN
    assert config.height_scan.noise > 0.0 < config.height_scan.delay
    words = f"{SIGHTED} --labels 9 --mixture flat 1 --scan.noise 0.1"
    changed = distil.parse(words.split())
    assert (changed.labels, changed.mixture, changed.scan.noise) == (9, (("flat", 1.0),), 0.1)
    blind = distil.parse(["--teacher", "mpc_wbc_sighted"])
    assert (blind.mixture, blind.folder.name) == (settings.MIXTURE, "simple_quad-student-0")
    assert blind.height_scan is None


@pytest.mark.parametrize("suffix", ["", HARDWARE])
@pytest.mark.parametrize("axis", ["rough", "stairs", "gravel"])
def test_the_mixture_has_robots_on_every_level_of_uneven_ground_that_can_rise(axis: str, suffix: str) -> None:
    """A segment has enough command intervals of each level for the curriculum."""
    config = distil.parse(SIGHTED.split())
    counts = distribute_robots(config.mixture, config.envs, SIMPLE_QUAD)
    steps = config.segment_rounds * config.round_steps
    for level in range(1, len(axes_of(SIMPLE_QUAD)[axis].levels) + 1):
        name = f"{axis}:{level}{suffix}"
        whole, unfinished = divmod(steps, scenario(name).commands.steps(CONTROL_PERIOD))
        intervals = whole + (unfinished * CONTROL_PERIOD >= MIN_UNFINISHED_TIME)
        assert counts[name] * intervals >= MIN_INTERVALS, name


def test_the_mixture_has_all_scenarios_of_a_blind_student_and_lost_scans() -> None:
    counts = distribute_robots(settings.SIGHTED_MIXTURE, 256, SIMPLE_QUAD)
    plain = {name.replace("+scan_dropouts", "") for name in counts}
    assert {name for name, _ in settings.MIXTURE} <= plain
    found = [scenario(name) for name in counts]
    robots = np.array(list(counts.values()))
    lost = np.array([each.scan_lost for each in found])
    dropping = np.array([each.scan_dropouts is not None for each in found])
    assert not (lost & dropping).any()
    assert 0.08 < robots[lost].sum() / robots.sum() < 0.3
    assert 0.2 < robots[dropping].sum() / robots.sum() < 0.5
    on_hardware = np.array([each.hardware for each in found])
    assert (lost & on_hardware).any()
    assert (dropping & on_hardware).any()


def test_the_validation_has_hard_ground_and_a_lost_scan() -> None:
    found = [scenario(name) for name in settings.SIGHTED_VALIDATION_SCENARIOS]
    assert {("rough", 0.24, False), ("stairs", 0.15, False), ("rough", 0.24, True)} <= {
        (each.axis, each.severity, each.scan_lost) for each in found
    }
    assert set(settings.VALIDATION_SCENARIOS) < set(settings.SIGHTED_VALIDATION_SCENARIOS)


@NEEDS_MODELS
def test_the_validation_is_scaled_to_another_robot() -> None:
    ground = [scenario(name, get_robot("go1")).severity for name in ("rough:4", "stairs:3")]
    assert 0.05 < ground[0] < 0.24
    assert 0.03 < ground[1] < 0.15


def test_a_blind_student_of_a_sighted_teacher_is_possible_and_one_line_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "blind"
    assert main([*f"--teacher mpc_wbc_sighted {COMMON} --labels 200".split(), "--out", str(folder)]) == 0
    said = [line for line in capsys.readouterr().out.splitlines() if "--sighted" in line]
    assert len(said) == 1
    assert "--sighted: not given, but mpc_wbc_sighted has a height scan; the student has none" in said[0]
    policy = policies.load(folder)
    assert (policy.name, policy.height_scan) == ("student", None)


def test_nothing_is_said_about_scans_if_both_have_one_or_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*WORDS, "--labels", "200", "--out", str(tmp_path / "sighted")]) == 0
    assert main([*f"--teacher trot {COMMON} --labels 200".split(), "--out", str(tmp_path / "blind")]) == 0
    assert "--sighted" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--teacher mpc_wbc --sighted", "--sighted: the teacher has no height scan, got mpc_wbc; valid: mpc_wbc_sigh"),
        ("--teacher mpc_wbc_sighted --scan.noise 0.1", "--scan: needs --sighted"),
        ("--teacher mpc_wbc_sighted --sighted --scan.spacing 0", "spacing"),
        ("--teacher mpc_wbc_sighted --sighted --scan.rate 33", "control rate"),
        ("--teacher mpc_wbc_sighted --sighted --scan.ahead 9000", "at most 10000 points"),
    ],
)
def test_a_wrong_option_gets_one_line(
    words: str, message: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main([*words.split(), "--out", str(tmp_path / "new")]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (tmp_path / "new").exists()


def test_a_resumed_run_keeps_its_scan(finished: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--resume", "--out", str(finished), "--scan.noise", "0.5"]) == 2
    assert "--scan.noise: the run has 0.02, the command 0.5" in capsys.readouterr().err


def test_ppo_continues_with_the_scan_of_a_sighted_student(finished: Path, tmp_path: Path) -> None:
    recipe = f"--policy end-to-end --recipe improve --servo stiff --start {finished}"
    config = run.parse(recipe.split())
    assert (config.sighted, config.scan, config.base) == (True, SCAN, "stand")
    assert run.parse([*recipe.split(), "--sighted"]) == config
    found = [scenario(name) for name, _ in config.mixture]
    assert {("rough", 0.24, False), ("stairs", 0.15, False), ("rough", 0.24, True)} <= {
        (each.axis, each.severity, each.scan_lost) for each in found
    }
    plain = {name.replace("+scan_dropouts", "") for name, _ in config.mixture}
    assert {name for name, _ in IMPROVE_MIXTURE} <= plain
    assert {"rough:4", "stairs:3", "rough:4+scan_lost"} <= set(config.validation.scenarios)
    brief = (
        "--threads 1 --mixture flat 0.5 rough+scan_lost 0.5 --steps 64 --ppo.envs 8 --ppo.rollout-steps 4 "
        "--ppo.minibatch 32 --ppo.epochs 1 --ppo.critic 8 --ppo.critic-steps 0 --validation.episodes 1 "
        "--validation.scenarios flat --validation.interval 0 --max-episode-steps 30"
    )
    assert main([*recipe.split(), *brief.split(), "--out", str(tmp_path / "improved")]) == 0
    policy = policies.load(tmp_path / "improved")
    assert policy.height_scan == SCAN
    command = json.loads((tmp_path / "improved" / "run.json").read_bytes())["command"]
    assert run.parse(shlex.split(command)[3:]) == load_config(tmp_path / "improved")
