"""Faulty files of other projects: the error is one line with the file and the key, and no code of the file runs."""

import time
from collections.abc import Callable
from contextlib import suppress
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from policies.base import PolicyError
from policies.external.readers import read

pytest.importorskip("yaml")
pytest.importorskip("onnx")

from tests.policies.external.readers import files
from tests.policies.external.readers.files import MOTORS, network, write_settings


def refusal(file: Path) -> str:
    """Return the error message of a file; it is one line."""
    with pytest.raises(PolicyError) as error:
        read(file)
    assert "\n" not in str(error.value)
    assert str(error.value).startswith(f"{file}: ")
    return str(error.value).removeprefix(f"{file}: ")


def path(keys: str, value: Any) -> Callable[[dict[str, Any]], None]:
    """Return a function that sets the value at nested keys, or deletes it if `value` is None."""

    def change(settings: dict[str, Any]) -> None:
        *above, last = keys.split("/")
        for key in above:
            settings = settings[key]
        if value is None:
            del settings[last]
        else:
            settings[last] = value

    return change


DEPLOY = [
    (path("stiffness", None), "deploy.yaml has no `stiffness`"),
    (path("stiffness", [1.0] * 11), "`stiffness` in deploy.yaml must be 12 numbers"),
    (path("stiffness", [float("nan")] * 12), "`stiffness` in deploy.yaml must be 12 numbers"),
    (path("step_dt", 0), "a time step, a period or a scale is zero"),
    (path("joint_ids_map", [0] * 12), "`joint_ids_map` in deploy.yaml must be the numbers from 0 to 11"),
    (path("joint_ids_map", list(range(29))), "`joint_ids_map` in deploy.yaml must be 12 numbers"),
    (path("actions/JointPositionAction/scale", [1.0] * 3), "`actions.JointPositionAction.scale` in deploy.yaml must"),
    (path("actions/JointVelocityAction", {}), "`actions` in deploy.yaml must be JointPositionAction alone"),
    (path("observations/height_scan", {"params": {}}), "the observation term height_scan is not known; write a TOML"),
    (path("observations/gait_phase", {"params": {}}), "has no `observations.gait_phase.params.period`"),
    (path("observations/base_ang_vel/scale", [1.0] * 4), "`scale` must be 1 or 3 numbers"),
    (path("observations/joint_pos_rel/params", {"asset_cfg": {"joint_ids": files.permutation(3)}}), "several orders"),
]
ENV = [
    (path("scene/robot", None), "env.yaml has no `scene.robot`"),
    (path("scene/robot/actuators/hips/stiffness", None), "has no `scene.robot.actuators.hips.stiffness`"),
    (path("scene/robot/actuators/legs", None), "no actuator in env.yaml has the joint FL_thigh_joint"),
    (path("scene/robot/init_state/joint_pos/.*_hip_joint", 0.2), "has .*L_hip_joint and .*_hip_joint for FL_hip_joint"),
    (
        path("scene/robot/init_state/joint_pos/knee", 0.2),
        "unknown order of the joints; known: go1",
    ),
    (
        path("scene/robot/spawn/usd_path", "mine/robot.usd"),
        "unknown order of the joints; known: ",
    ),
    (
        path("sim/newton_cfg", {"num_substeps": 1}),
        "go1, go2, a1, b1, b2, aliengo, unitree, anymal, spot, lite3, deeprobotics",
    ),
    (path("scene/robot/actuators/hips/joint_names_expr", ["("]), "'(' is not a supported regular expression"),
    (
        path("actions/joint_pos/class_type", "x:JointVelocityAction"),
        "the actions are joint_pos (x:JointVelocityAction); supported: one Joint",
    ),
    (
        path("commands/base_velocity/class_type", "x:UniformPoseCommand"),
        "the command base_velocity is a UniformPoseComm",
    ),
    (path("observations/policy/base_ang_vel/func", "mine:estimated"), "the observation term estimated is not known"),
    (
        path("observations/policy/base_ang_vel/modifiers", [1]),
        "the observation term base_ang_vel with modifiers is not",
    ),
    (path("observations/policy/base_ang_vel/clip", [1.0, -1.0]), "`clip` must be a minimum and a larger maximum"),
]
RL_SAR = [
    (path("model_name", None), "not a known deployment file"),
    (path("num_of_dofs", 16), "`num_of_dofs` in config.yaml and in ../base.yaml disagree"),
    (path("dt", 0.002), "`dt` in config.yaml and in ../base.yaml disagree"),
    (path("joint_names", list(MOTORS[::-1])), "`joint_names` in config.yaml and in ../base.yaml disagree"),
    (path("observations", ["phase"]), "the observation term phase is not known; write a TOML"),
    (path("observations_history", [0, 2]), "must be the steps from 0, or down to 0"),
    (path("dof_vel_scale", None), "config.yaml has no `go2/robot_lab.dof_vel_scale`"),
    (path("model_name", "other.pt"), "there is no network"),
    (path("clip_actions_upper", list(range(12))), "must be equal for all joints"),
]
LEGGED_GYM = [
    (path("control/control_type", "T"), "`control.control_type` in settings.yaml must be P"),
    (
        path("control/use_actuator_network", True),
        "`control.use_actuator_network` in settings.yaml: the joints were trained with a network of",
    ),
    (path("control/stiffness/hip", None), "`control.stiffness` in settings.yaml has nothing for FL_hip_joint"),
    (path("env/num_observations", 45), "the observation is 45 numbers, and legged_gym's terms are 48"),
    (path("init_state/default_joint_angles/tail", 0.0), "unknown order of the joints RL_calf_joint, "),
    (path("normalization/obs_scales/dof_vel", "fast"), "`normalization.obs_scales.dof_vel` in settings.yaml must be a"),
]
MJLAB = [
    (path("joint_stiffness", None), "policy.onnx has no `joint_stiffness`"),
    (path("joint_stiffness", "much"), "`joint_stiffness` in policy.onnx must be 12 numbers, not 'much'"),
    (path("joint_names", "a,b"), "`joints` must be the names of 12 different joints"),
    (path("observation_names", "base_ang_vel,phase"), "policy.onnx has no `phase.params`; add it, or write a TOML"),
    (path("observation_names", "height_scan"), "the observation term height_scan is not known; write a TOML"),
    (path("observation_terms_scale", "1.000,1.000"), "`observation_terms_…` and `observation_names` in policy.onnx"),
    (path("command_names", "twist,pose"), "the commands are twist, pose; supported: one velocity command"),
]


def cases(table: list[Any]) -> Any:
    return pytest.mark.parametrize(("change", "line"), table, ids=[line for _, line in table])


@cases(DEPLOY)
def test_a_faulty_deploy_yaml(tmp_path: Path, change: Callable[..., None], line: str) -> None:
    change(found := files.deploy(files.permutation(0)))
    network(tmp_path)
    assert line in refusal(write_settings(tmp_path / "params/deploy.yaml", found))


@cases(ENV)
def test_a_faulty_env_yaml(tmp_path: Path, change: Callable[..., None], line: str) -> None:
    change(found := files.env())
    network(tmp_path)
    assert line in refusal(write_settings(tmp_path / "params/env.yaml", found))


@cases(RL_SAR)
def test_a_faulty_rl_sar_file(tmp_path: Path, change: Callable[..., None], line: str) -> None:
    config, base = files.rl_sar(files.permutation(0))
    change(config["go2/robot_lab"])
    write_settings(tmp_path / "go2/base.yaml", base)
    network(tmp_path, "go2/robot_lab/policy.pt")
    assert line in refusal(write_settings(tmp_path / "go2/robot_lab/config.yaml", config))


@cases(LEGGED_GYM)
def test_faulty_settings_of_legged_gym(tmp_path: Path, change: Callable[..., None], line: str) -> None:
    change(found := files.legged_gym())
    network(tmp_path)
    assert line in refusal(write_settings(tmp_path / "settings.yaml", found))


@cases(MJLAB)
def test_faulty_metadata(tmp_path: Path, change: Callable[..., None], line: str) -> None:
    change(found := files.mjlab(MOTORS))
    assert line in refusal(files.onnx_file(tmp_path / "policy.onnx", found))


def test_weights_in_another_file_are_not_read(tmp_path: Path) -> None:
    assert "the weights of p.onnx lie in another file" in refusal(
        files.onnx_file(tmp_path / "p.onnx", {}, outside=True)
    )
    (tmp_path / "p.onnx").write_bytes(b"\xff\xff no onnx")
    assert "p.onnx cannot be read as ONNX" in refusal(tmp_path / "p.onnx")


def test_a_network_with_weights_elsewhere_or_other_joints_is_refused_with_its_settings(tmp_path: Path) -> None:
    file = write_settings(tmp_path / "params/deploy.yaml", files.deploy(list(range(12))))
    net = network(tmp_path)
    files.onnx_file(net, {}, outside=True)
    assert "the weights of policy.onnx lie in another file" in refusal(file)
    files.onnx_file(net, files.mjlab(MOTORS[::-1]))
    assert "`joint_names` in policy.onnx disagree, RL_calf_joint," in refusal(file)
    files.onnx_file(net, files.mjlab(MOTORS))
    assert read(file) is not None


def test_a_network_that_is_missing_or_one_of_several_is_asked_for(tmp_path: Path) -> None:
    file = write_settings(tmp_path / "params/deploy.yaml", files.deploy(files.permutation(0)))
    assert "no network for deploy.yaml" in refusal(file)
    network(tmp_path, "a.onnx")
    network(tmp_path, "b.onnx")
    assert "several networks for deploy.yaml: a.onnx, b.onnx" in refusal(file)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (
            "joint_ids_map: !!python/object/apply:os.system ['touch ran']",
            "line 1 has the unsupported tag !!python/object/apply:os.system",
        ),
        ("a: 1\nb: !!python/name:os.system", "line 2 has the unsupported tag !!python/name:os.system"),
        ("a: !mine 1", "no settings: ValueError: could not determine a constructor for the tag '!mine'"),
        ("a: [1, 2", "no settings: ValueError"),
        ("[" * 5000, "no settings: ValueError"),
        ("- 1\n- 2", "holds no settings by key"),
        ("a: \x00", "no settings: ValueError"),
        ("FSM: {}", "not a known deployment file; valid: a deploy.yaml of Unitree"),
        ("a: &a [1, 2]\nb: *a\nc: *c", "no settings: ValueError"),
    ],
)
def test_yaml_that_holds_no_settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, line: str) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "policy.yaml").write_text(text)
    assert line in refusal(tmp_path / "policy.yaml")
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("line", ["", "joint: 1.0"])
def test_a_million_lines_are_refused_at_once(tmp_path: Path, line: str) -> None:
    (tmp_path / "policy.yaml").write_text(f"{line}\n" * 10**6)
    start = time.perf_counter()
    assert refusal(tmp_path / "policy.yaml").startswith(
        ("policy.yaml has 1000000 lines", "cannot read policy.yaml (it is")
    )
    assert time.perf_counter() - start < 1


def test_json_and_folders(tmp_path: Path) -> None:
    (tmp_path / "policy.json").write_text('{"env": 1, "env": 2}')
    assert "'env' is given twice" in refusal(tmp_path / "policy.json")
    (tmp_path / "folder.yaml").mkdir()
    assert "cannot read folder.yaml" in refusal(tmp_path / "folder.yaml")
    assert "cannot read none.yaml" in refusal(tmp_path / "none.yaml")
    assert "cannot read none.toml" in refusal(tmp_path / "none.toml")


def places(settings: dict[str, Any], above: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """Return the nested keys of all values, at any depth."""
    deeper = [
        place for key, value in settings.items() if isinstance(value, dict) for place in places(value, (*above, key))
    ]
    return [(*above, key) for key in settings] + deeper


ODD = [None, "x", [], {}, -1, 0, 1e300, [[]], True, {"a": {}}, [None] * 12, ["x"] * 12, 10**400, ["("], [2, 1]]


@pytest.mark.parametrize(
    ("file", "settings"), [("d.yaml", files.deploy(files.permutation(0))), ("e.yaml", files.env())]
)
def test_any_value_of_any_key_is_understood_or_refused(tmp_path: Path, file: str, settings: dict[str, Any]) -> None:
    network(tmp_path)
    rng, keys = np.random.default_rng(0), places(settings)
    for number in rng.integers(len(keys), size=100):
        changed = inner = deepcopy(settings)
        for key in keys[number][:-1]:
            inner = inner[key]
        inner[keys[number][-1]] = ODD[rng.integers(len(ODD))]
        with suppress(PolicyError):
            read(write_settings(tmp_path / file, changed))
