"""Every number of a file of another project is stored in its own field: all numbers of the files differ."""

from pathlib import Path
from typing import Any

import pytest

from policies.external.readers import read
from policies.external.spec import HeightGrid, PolicySpec, SpecTerm

pytest.importorskip("yaml")

from tests.policies.external.readers import files
from tests.policies.external.readers.files import JOINT_VALUES, MOTORS, joint_values, network, write_settings


def described(folder: Path, settings: Any, name: str = "settings.yaml") -> PolicySpec:
    network(folder, "policy.pt")
    network(folder)
    found = read(write_settings(folder / name, settings))
    assert found is not None
    return found


def legged_gym() -> dict[str, Any]:
    found = files.legged_gym()
    found["control"] |= {"damping": {"hip": 0.6, "thigh": 0.7, "calf": 0.8}, "action_scale": 0.3, "decimation": 5}
    found["normalization"] |= {"clip_observations": 90.0, "clip_actions": 40.0}
    scales = {"lin_vel": 2.1, "ang_vel": 0.26, "dof_pos": 1.1, "dof_vel": 0.06, "height_measurements": 5.1}
    found["normalization"]["obs_scales"] = scales
    found["sim"]["dt"] = 0.004
    return found


def test_of_legged_gym(tmp_path: Path) -> None:
    settings = legged_gym()
    settings["terrain"]["measure_heights"], settings["env"]["num_observations"] = True, 48 + 6
    found = described(tmp_path, settings)
    assert found.control_rate == pytest.approx(50.0)
    assert (found.action_clip, found.observation_clip) == ((-40.0, 40.0), 90.0)
    assert found.action_scale == pytest.approx((0.3,) * 12)
    assert found.stiffness == (20.0, 30.0, 40.0) * 4
    assert found.damping == (0.6, 0.7, 0.8) * 4
    assert found.default_position == tuple(JOINT_VALUES[joint] for joint in found.joints)
    grid = HeightGrid((-0.1, 0.0, 0.1), (0.0, 0.2), x_first=False, offset=0.5)
    assert found.terms == (
        SpecTerm("linear_velocity", (2.1,)),
        SpecTerm("angular_velocity", (0.26,)),
        SpecTerm("projected_gravity"),
        SpecTerm("command", (2.1, 2.1, 0.26)),
        SpecTerm("joint_position", (1.1,)),
        SpecTerm("joint_velocity", (0.06,)),
        SpecTerm("previous_action"),
        SpecTerm("height_scan", (5.1,), (-1.0, 1.0), grid=grid),
    )


def test_of_himloco(tmp_path: Path) -> None:
    settings = legged_gym()
    settings["env"] = {"num_observations": 90, "num_one_step_observations": 45}
    settings["control"] |= {"hip_reduction": 0.5, "hip_scale_reduction": 0.8}
    found = described(tmp_path, settings)
    assert found.action_scale == pytest.approx((0.12, 0.3, 0.3) * 4)
    assert found.terms == (
        SpecTerm("command", (2.1, 2.1, 0.26), history=2),
        SpecTerm("angular_velocity", (0.26,), history=2),
        SpecTerm("projected_gravity", history=2),
        SpecTerm("joint_position", (1.1,), history=2),
        SpecTerm("joint_velocity", (0.06,), history=2),
        SpecTerm("previous_action", history=2),
    )


def test_of_rl_sar(tmp_path: Path) -> None:
    """The policy's file overrides the base file of the robot."""
    config, base = files.rl_sar(list(range(12)))
    own = config["go2/robot_lab"]
    own |= {"clip_obs": 90.0, "ang_vel_scale": 0.26, "dof_pos_scale": 1.1, "dof_vel_scale": 0.06}
    own |= {"commands_scale": [2.1, 2.2, 0.27], "lin_vel_scale": 2.3, "observations": ["lin_vel", *own["observations"]]}
    own |= {"clip_actions_lower": [-30.0] * 12, "clip_actions_upper": [50.0] * 12}
    own |= {"rl_kd": joint_values(MOTORS, 0.3), "default_dof_pos": joint_values(MOTORS, 0.7)}
    base["go2"] |= {"dt": 0.004, "decimation": 5, "clip_obs": 1.0, "rl_kd": [9.0] * 12}
    write_settings(tmp_path / "go2/base.yaml", base)
    network(tmp_path, "go2/robot_lab/policy.pt")
    found = described(tmp_path, config, "go2/robot_lab/config.yaml")
    assert found.control_rate == pytest.approx(50.0)
    assert (found.action_clip, found.observation_clip) == ((-30.0, 50.0), 90.0)
    assert found.stiffness == tuple(joint_values(MOTORS, 20.0))
    assert found.damping == tuple(joint_values(MOTORS, 0.3))
    assert found.action_scale == tuple(joint_values(MOTORS, 0.25))
    assert found.default_position == tuple(joint_values(MOTORS, 0.7))
    assert found.terms == (
        SpecTerm("linear_velocity", (2.3,), history=3),
        SpecTerm("command", (2.1, 2.2, 0.27), history=3),
        SpecTerm("angular_velocity", (0.26,), history=3),
        SpecTerm("projected_gravity", history=3),
        SpecTerm("joint_position", (1.1,), history=3),
        SpecTerm("joint_velocity", (0.06,), history=3),
        SpecTerm("previous_action", history=3),
    )


def test_of_unitree_s_deploy(tmp_path: Path) -> None:
    ids = [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8]
    settings = files.deploy(ids)
    for number, name in enumerate(files.TERMS):
        settings["observations"][name] |= {"scale": 0.1 + 0.1 * number, "clip": [-1.0 - number, 2.0 + number]}
    action = settings["actions"]["JointPositionAction"]
    joints = tuple(MOTORS[each] for each in ids)
    action |= {"offset": joint_values(joints, 0.9), "clip": [[-each, 2.0 * each] for each in joint_values(joints)]}
    settings |= {"step_dt": 0.025}
    found = described(tmp_path, settings, "params/deploy.yaml")
    assert found.control_rate == pytest.approx(40.0)
    assert found.action_offset == tuple(joint_values(joints, 0.9))
    assert found.default_position == tuple(joint_values(joints))
    assert found.action_scale == tuple(joint_values(joints, 0.25))
    assert found.stiffness == tuple(joint_values(joints, 20.0))
    assert found.damping == tuple(joint_values(joints, 0.5))
    assert found.target_clip == tuple((-each, 2.0 * each) for each in joint_values(joints))
    scales = [term.scale[0] for term in found.terms]
    assert scales == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    assert [term.clip for term in found.terms] == [(-1.0 - each, 2.0 + each) for each in range(6)]


def test_of_isaac_lab(tmp_path: Path) -> None:
    settings = files.env()
    policy = settings["observations"]["policy"]
    for number, name in enumerate(files.TERMS):
        policy[name] |= {"scale": 0.1 + 0.1 * number, "clip": [-1.0 - number, 2.0 + number]}
    settings |= {"decimation": 5, "sim": {"dt": 0.004}}
    action = settings["actions"]["joint_pos"]
    action |= {
        "use_default_offset": False,
        "offset": {".*_hip_joint": 0.1, ".*_thigh_joint": 0.2, ".*_calf_joint": 0.3},
    }
    action |= {"clip": {".*_hip_joint": [-1.0, 2.0], ".*_thigh_joint": [-3.0, 4.0], ".*_calf_joint": [-5.0, 6.0]}}
    write_settings(tmp_path / "params/agent.yaml", {"clip_actions": 7.0})
    found = described(tmp_path, settings, "params/env.yaml")
    assert found.control_rate == pytest.approx(50.0)
    assert found.action_offset == (0.1,) * 4 + (0.2,) * 4 + (0.3,) * 4
    assert found.target_clip == ((-1.0, 2.0),) * 4 + ((-3.0, 4.0),) * 4 + ((-5.0, 6.0),) * 4
    assert found.action_clip == (-7.0, 7.0)
    assert found.stiffness == (20.0,) * 4 + (30.0,) * 4 + (40.0,) * 4
    assert found.damping == (0.5,) * 4 + (1.0,) * 8
    scales = [term.scale[0] for term in found.terms]
    assert scales == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    assert [term.clip for term in found.terms] == [(-1.0 - each, 2.0 + each) for each in range(6)]
