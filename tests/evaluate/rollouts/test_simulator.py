"""Runs in Drake: supported scenarios, refused options, messages, and reproducible episodes."""

from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from evaluate.__main__ import main
from evaluate.commands import replay
from evaluate.commands.options import EvaluateOptions
from evaluate.commands.plan import check, select_scenarios
from evaluate.hardware import IDEAL, HardwareConfig, describe_hardware
from evaluate.records import manifest as manifests
from evaluate.rollouts import rollout
from evaluate.rollouts.workers import estimated_steps
from quad_env.cli.command_line import UsageError
from quad_env.physics import simulators
from quad_env.physics.simulators import DRAKE, RELATIVE_STEP_TIME

pytest.importorskip("pydrake")


def test_the_simulator_is_written_down_where_it_is_not_the_usual_one() -> None:
    drake = HardwareConfig(simulator=DRAKE)
    assert HardwareConfig(**asdict(drake)) == drake
    assert not drake.is_customized
    assert "drake" in describe_hardware(drake)


def test_of_a_battery_it_takes_what_it_knows_and_names_the_rest(capsys: pytest.CaptureFixture[str]) -> None:
    names = {each.name for each in select_scenarios(EvaluateOptions(simulator=DRAKE, full=True))}
    assert {"flat", "steady", "push", "force", "slope", "stairs", "slippery", "payload"} <= names
    assert not {"rough", "gravel", "soft", "weak_motors", "slow_motors"} & names
    assert not {name for name in names if name.endswith("+hardware")}
    (line,) = capsys.readouterr().err.splitlines()
    assert all(name in line for name in ("rough", "gravel", "soft", "weak_motors", "flat+hardware"))


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"scenarios": ("push", "rough")}, "--scenarios rough: the simulator drake does not support"),
        ({"scenarios": ("push+hardware",)}, "--scenarios push"),
        ({"scenarios": ("push",), "hardware": True}, "the hardware profile of 'push"),
        ({"actuator": "motor"}, "motors other than ideal ones"),
        ({"sensors": "typical"}, "sensors"),
        ({"simulator": "bullet"}, "unknown simulator 'bullet'; valid: mujoco, drake"),
    ],
)
def test_anything_else_is_refused_in_a_line(asked: dict[str, object], said: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=said) as refused:
        check(EvaluateOptions(**{"simulator": DRAKE, "out": tmp_path / "out"} | asked))
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "out").exists()


def test_a_run_says_that_it_is_slow_comes_again_and_is_told_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(rollout, "STEPS", 110)
    run = ["--policies", "trot", "--scenarios", "push=35", "--episodes", "1", "--threads", "1", "--out", str(tmp_path)]
    assert main([*run, "--simulator", DRAKE]) == 0
    assert f"about {RELATIVE_STEP_TIME[DRAKE]:g} times as long" in capsys.readouterr().err
    made = manifests.read(tmp_path)
    assert made.versions["drake"]
    assert manifests.differences(made, replace(made, hardware=IDEAL)) == ["simulator was drake and is mujoco"]
    assert main(["replay", str(tmp_path), "0"]) == 0
    monkeypatch.setattr(simulators, "find_spec", lambda _: None)
    with pytest.raises(UsageError, match="pip install"):
        replay.main(replay.ReplayOptions(tmp_path, 0))


def test_a_task_costs_what_its_simulator_takes() -> None:
    tasks = [
        SimpleNamespace(episode_indices=range(3), steps=10, hardware=HardwareConfig(simulator=name))
        for name in RELATIVE_STEP_TIME
    ]
    assert [estimated_steps(task) for task in tasks] == [30, 30 * RELATIVE_STEP_TIME[DRAKE]]  # type: ignore[arg-type]
