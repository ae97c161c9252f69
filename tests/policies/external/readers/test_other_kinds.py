"""Files that contain only a part of a policy: their kind, their known fields, and a TOML to complete."""

import time
import tomllib
from pathlib import Path
from typing import Any

import pytest

from policies.base import PolicyError
from policies.external.readers import IncompleteSpecError, read, write_draft, write_toml
from policies.external.reference import resolve_reference
from policies.external.spec import SpecTerm

pytest.importorskip("yaml")
pytest.importorskip("onnx")

from tests.policies.external.readers import files
from tests.policies.external.readers.files import ISAAC, MOTORS, joint_values, network, permutation, write_settings

DEPLOY_MUJOCO = {
    "policy_path": "{LEGGED_GYM_ROOT_DIR}/deploy/pre_train/go2/motion.pt",
    "xml_path": "{LEGGED_GYM_ROOT_DIR}/resources/robots/go2/scene.xml",
    "simulation_duration": 60.0,
    "simulation_dt": 0.002,
    "control_decimation": 10,
    "kps": joint_values(MOTORS, 20.0),
    "kds": joint_values(MOTORS, 0.5),
    "default_angles": joint_values(MOTORS),
    "ang_vel_scale": 0.25,
    "dof_vel_scale": 0.05,
    "action_scale": 0.25,
    "cmd_scale": [2.0, 2.0, 0.25],
    "num_actions": 12,
    "num_obs": 48,
}


def incomplete(file: Path) -> IncompleteSpecError:
    """Return the draft of an incomplete file; the error is one line."""
    with pytest.raises(IncompleteSpecError) as error:
        read(file)
    assert "\n" not in str(error.value)
    assert str(error.value).startswith(f"{file}: ")
    return error.value


def descriptor(joints: tuple[str, ...], observed: tuple[str, ...], stiffness: float = 20.0) -> dict[str, Any]:
    """Return an IO descriptor of Isaac Lab with its articulation in the order ISAAC."""
    overloads = {"clip": None, "flatten_history_dim": True, "history_length": 0, "scale": None}
    path = "isaaclab.envs.mdp.observations."
    names = ("base_ang_vel", "projected_gravity", "generated_commands", "joint_pos_rel", "joint_vel_rel", "last_action")
    terms: list[dict[str, Any]] = [
        {"name": name, "full_path": path + name, "overloads": dict(overloads), "extras": {"modifiers": None}}
        for name in names
    ]
    for term, width in zip(terms, (3, 3, 3, 12, 12, 12), strict=True):
        term["shape"] = [width]
    for term in terms[3:5]:
        term["joint_names"] = list(observed)
    terms[0]["overloads"] |= {"scale": 0.25, "history_length": 3}
    terms[0]["shape"] = [9]
    action = {
        "full_path": "isaaclab.envs.mdp.actions.joint_actions.JointPositionAction",
        "name": "joint_position_action",
        "clip": None,
        "joint_names": list(joints),
        "offset": joint_values(joints),
        "scale": 0.5,
        "shape": [12],
    }
    robot = {
        "joint_names": list(ISAAC),
        "default_joint_pos": joint_values(ISAAC),
        "default_joint_stiffness": joint_values(ISAAC, stiffness),
        "default_joint_damping": joint_values(ISAAC, 0.5),
    }
    scene = {"dt": 0.02, "physics_dt": 0.005, "decimation": 4}
    return {"actions": [action], "articulations": {"robot": robot}, "observations": {"policy": terms}, "scene": scene}


@pytest.mark.parametrize("seed", range(2))
def test_an_io_descriptor_names_the_joints_of_each_term(tmp_path: Path, seed: int) -> None:
    joints, observed = (tuple(MOTORS[each] for each in permutation(seed + more)) for more in (0, 5))
    network(tmp_path)
    file = write_settings(tmp_path / "io_descriptors/walk_IO_descriptors.yaml", descriptor(joints, observed))
    policy = read(file)
    assert policy is not None
    assert policy.joints == joints
    assert policy.observed_joints == observed
    assert policy.default_position == tuple(joint_values(joints))
    assert policy.stiffness == tuple(joint_values(joints, 20.0))
    assert policy.damping == tuple(joint_values(joints, 0.5))
    assert policy.control_rate == pytest.approx(50)
    assert policy.terms[0] == SpecTerm("angular_velocity", (0.25,), history=3)
    assert [term.name for term in policy.terms][2:] == [
        "command",
        "joint_position",
        "joint_velocity",
        "previous_action",
    ]
    assert policy.network == tmp_path / "exported/policy.onnx"


def test_gains_of_explicit_actuators_are_those_of_the_env_yaml(tmp_path: Path) -> None:
    network(tmp_path)
    file = write_settings(tmp_path / "io_descriptors/walk_IO_descriptors.yaml", descriptor(ISAAC, ISAAC, 0.0))
    found = incomplete(file)
    assert found.missing == ("network", "stiffness", "damping")
    assert "an IO descriptor of Isaac Lab with explicit actuators" in str(found)
    write_settings(tmp_path / "params/env.yaml", files.env())
    policy = read(file)
    assert policy is not None
    assert policy.stiffness == (20.0,) * 4 + (30.0,) * 4 + (40.0,) * 4


def test_an_io_descriptor_gives_the_order_that_an_env_yaml_lacks(tmp_path: Path) -> None:
    network(tmp_path)
    found = files.env()
    found["scene"]["robot"]["spawn"]["usd_path"] = "mine/robot.usd"
    file = write_settings(tmp_path / "params/env.yaml", found)
    with pytest.raises(PolicyError, match=r"unknown order of the joints.*io_descriptors/\*\.yaml"):
        read(file)
    robot = descriptor(ISAAC, ISAAC)
    order = [ISAAC[each] for each in permutation(1)]
    robot["articulations"]["robot"]["joint_names"] = order
    write_settings(tmp_path / "io_descriptors/walk_IO_descriptors.yaml", robot)
    policy = read(file)
    assert policy is not None
    assert policy.joints == tuple(order)


def test_what_a_file_says_comes_whole_from_the_process_that_reads_it(tmp_path: Path) -> None:
    file = write_settings(tmp_path / "go2.yaml", DEPLOY_MUJOCO)
    network(tmp_path, "motion.pt")
    with pytest.raises(IncompleteSpecError) as error:
        resolve_reference(file, trust=True)
    expected = incomplete(file)
    assert str(error.value) == str(expected)
    assert (error.value.known, error.value.advice) == (expected.known, expected.advice)


def test_deploy_mujocos_settings_are_named_and_drafted(tmp_path: Path) -> None:
    net = network(tmp_path, "motion.pt")
    found = incomplete(write_settings(tmp_path / "go2.yaml", DEPLOY_MUJOCO))
    assert "it is a configuration of unitree_rl_gym's deploy_mujoco, which does not say `joints`, `terms`" in str(found)
    assert f"doctor --policy {tmp_path / 'go2.yaml'} --write mine.toml" in str(found)
    draft = tmp_path / "mine.toml"
    write_draft(found, draft)
    text = draft.read_text(encoding="utf-8")
    assert "# num_obs = 48; perhaps linear_velocity, angular_velocity" in text
    with pytest.raises(PolicyError, match="`joints` is missing"):
        read(draft)
    lines = [
        line.removeprefix("# ") if line.startswith(("# joints", "# terms")) else line for line in text.splitlines()
    ]
    draft.write_text("\n".join(lines), encoding="utf-8")
    policy = read(draft)
    assert policy is not None
    assert policy.network == net
    assert policy.control_rate == pytest.approx(50)
    assert policy.stiffness == tuple(joint_values(MOTORS, 20.0))
    assert policy.default_position == tuple(joint_values(MOTORS))
    assert (policy.action_scale, policy.width) == ((0.25,) * 12, 48)


def test_flat_settings_with_rl_sars_keys_are_read_or_drafted(tmp_path: Path) -> None:
    config, base = files.rl_sar(list(range(12)))
    flat = base["go2"] | config["go2/robot_lab"]
    del flat["joint_mapping"]
    network(tmp_path, "policy.pt")
    policy = read(write_settings(tmp_path / "runner.yaml", flat))
    assert policy is not None
    assert policy.joints == MOTORS
    assert policy.terms[0] == SpecTerm("command", (2.0, 2.0, 0.25), history=3)
    assert policy.stiffness == tuple(joint_values(MOTORS, 20.0))
    del flat["joint_names"]
    found = incomplete(write_settings(tmp_path / "runner.yaml", flat))
    assert found.missing == ("joints", "terms")
    assert "flat settings with rl_sar's keys" in str(found)


def test_a_file_of_rl_sar_that_names_no_observation_is_drafted(tmp_path: Path) -> None:
    config, _ = files.rl_sar(list(range(12)))
    own = config["go2/robot_lab"]
    del own["observations"], own["observations_history"]
    own |= {"use_history": True, "dt": 0.005, "decimation": 4}
    net = network(tmp_path, "policy.pt")
    found = incomplete(write_settings(tmp_path / "config.yaml", config))
    assert "a config.yaml of rl_sar v2.1 or older, which does not say `joints`, `terms`" in str(found)
    assert found.known["network"] == net
    assert found.known["damping"] == tuple(joint_values(MOTORS, 0.5))


def test_other_flat_settings_are_named(tmp_path: Path) -> None:
    settings = {
        "kp": 20.0,
        "kd": 0.5,
        "default_joint_pos": joint_values(MOTORS),
        "joint_names": list(MOTORS),
        "onnx_path": "a.onnx",
    }
    found = incomplete(write_settings(tmp_path / "mine.json", settings))
    assert found.missing == ("network", "control_rate", "action_scale", "terms")
    write_draft(found, tmp_path / "mine.toml")
    known = tomllib.loads((tmp_path / "mine.toml").read_text(encoding="utf-8"))
    assert known["stiffness"] == 20.0
    assert known["joints"] == list(MOTORS)
    with pytest.raises(PolicyError, match=r"`kp` in mine\.json must be 12 numbers"):
        read(write_settings(tmp_path / "mine.json", settings | {"kp": "soft"}))


def test_a_whole_description_stays_a_whole_toml(tmp_path: Path) -> None:
    network(tmp_path)
    policy = read(write_settings(tmp_path / "params/deploy.yaml", files.deploy(permutation(0))))
    assert policy is not None
    write_toml(policy, tmp_path / "policy.toml")
    assert read(tmp_path / "policy.toml") == policy


BOMB = "a0: &a0 [x, x, x]\n" + "".join(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 9))
"""YAML anchors; the last one expands to a hundred million leaves."""


@pytest.mark.parametrize("key", ["ang_vel_scale", "cmd_scale", "dof_vel_scale"])
def test_nested_aliases_in_flat_settings_take_no_time(tmp_path: Path, key: str) -> None:
    network(tmp_path, "motion.pt")
    file = write_settings(tmp_path / "go2.yaml", {**DEPLOY_MUJOCO, key: "PLACE"})
    file.write_text(BOMB + file.read_text().replace("PLACE", "*a8"))
    began = time.process_time()
    error = incomplete(file)
    assert time.process_time() - began < 2.0
    (line,) = (each for each in error.advice if each.startswith(f"{key} = "))
    assert len(line) < 200


@pytest.mark.parametrize("key", ["full_path", "name"])
@pytest.mark.parametrize("group", ["actions", "observations"])
def test_nested_aliases_in_an_io_descriptor_are_refused_at_once(tmp_path: Path, group: str, key: str) -> None:
    network(tmp_path)
    settings = descriptor(ISAAC, ISAAC)
    entry = settings["actions"][0] if group == "actions" else settings["observations"]["policy"][0]
    entry |= {"full_path": None, key: "PLACE"}
    file = write_settings(tmp_path / "io_descriptors/IO_descriptors.yaml", settings)
    file.write_text(BOMB + file.read_text().replace("PLACE", "*a8"))
    began = time.process_time()
    with pytest.raises(PolicyError, match=f"{key}` in .* must be a text, not "):
        read(file)
    assert time.process_time() - began < 2.0
