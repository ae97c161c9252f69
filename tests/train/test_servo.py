"""Servo gains of a training: a line says which, and a policy that was trained with other ones is refused."""

import re
from pathlib import Path

import numpy as np
import pytest

import policies
from policies.bundle import save
from policies.network import Network
from policies.poses import Stand
from policies.residual import Features, ResidualPolicy
from quad_env.cli.command_line import UsageError
from quad_env.robots.registry import get_robot
from tests.robot_models import NEEDS_MODELS
from train.__main__ import main
from train.commands.run import parse
from train.run_folder import LAST
from train.servo import check_resumed_servo, check_start_servo, describe_servo

END_TO_END = "--policy end-to-end --base stand"
STIFF = "191 N·m/rad and 5.37 N·m·s/rad"
GO1 = "35 N·m/rad and 0.5 N·m·s/rad"
TINY = (
    "--threads 1 --steps 16 --mixture flat 1 --ppo.envs 2 --ppo.rollout-steps 2 --ppo.minibatch 4 --ppo.epochs 1 "
    "--validation.interval 0 --validation.episodes 1 --max-episode-steps 20"
)


def end_to_end(words: str = "") -> policies.ResidualPolicy:
    """Return a residual policy on the pose `stand` of go1; the argument `maker` gives the maker's servo gains."""
    robot = get_robot("go1")
    base = Stand(robot=robot.with_servo() if words == "maker" else robot)
    weights = np.zeros((Features(base).width, 12), np.float32)
    return ResidualPolicy(base, Network((weights,), (np.zeros(12, np.float32),)))


@NEEDS_MODELS
@pytest.mark.parametrize(
    ("words", "line"),
    [
        (END_TO_END, "300 N·m/rad and 10 N·m·s/rad (simple_quad's own)"),
        (f"{END_TO_END} --robot go1", f"{GO1} (go1's own)"),
        (f"{END_TO_END} --robot go1 --servo stiff", f"{STIFF} (--servo stiff)"),
        (f"{END_TO_END} --robot go1 --servo 40/1", "40 N·m/rad and 1 N·m·s/rad (--servo 40/1)"),
        ("--robot go1 --base trot", f"{STIFF} (trot's)"),
        ("--robot go1 --base mpc_wbc", f"{GO1} (go1's own)"),
        ("", "150 N·m/rad and 7.5 N·m·s/rad (trot_reference's)"),
    ],
)
def test_a_line_says_which_gains_a_training_has(words: str, line: str) -> None:
    assert describe_servo(parse(words.split())) == f"servos: {line}"


@NEEDS_MODELS
def test_a_policy_of_other_gains_is_no_start_and_the_option_that_makes_it_one_is_named() -> None:
    config = parse(f"{END_TO_END} --robot go1 --start models/older".split())
    check_start_servo(config, end_to_end("maker"))
    words = f"models/older has servos of {STIFF}, this run of {GO1}; give --servo stiff"
    with pytest.raises(ValueError, match=f"^{re.escape(words)}$"):
        check_start_servo(config, end_to_end())
    stiff = parse(f"{END_TO_END} --robot go1 --start models/older --servo stiff".split())
    check_start_servo(stiff, end_to_end())
    with pytest.raises(ValueError, match=r"give --servo 35\.0/0\.5$"):
        check_start_servo(stiff, end_to_end("maker"))


@NEEDS_MODELS
def test_a_run_that_an_earlier_version_began_on_other_gains_is_not_continued(tmp_path: Path) -> None:
    config = parse([*f"{END_TO_END} --robot go1 --out".split(), str(tmp_path)])
    check_resumed_servo(config)
    save(tmp_path / LAST, end_to_end("maker"), training={}, git_revision="")
    check_resumed_servo(config)
    save(tmp_path / LAST, end_to_end(), training={}, git_revision="")
    with pytest.raises(UsageError, match=rf"^--resume: .*{STIFF}.*{GO1}; .*--start {tmp_path} --servo stiff$"):
        check_resumed_servo(config)


@NEEDS_MODELS
def test_a_training_end_to_end_on_go1_prints_its_gains_and_its_policy_commands_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    assert main([*f"{END_TO_END} --robot go1 {TINY} --out".split(), str(out)]) == 0
    assert re.findall(r"^servos: .*", capsys.readouterr().out, re.MULTILINE) == [f"servos: {GO1} (go1's own)"]
    assert policies.load(out / LAST, "go1").robot.servo == GO1
