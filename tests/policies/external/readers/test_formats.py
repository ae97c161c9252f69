"""Files of other projects: any joint order, scales and clips of terms, both layouts of a history."""

from pathlib import Path
from typing import Any

import pytest

from policies.base import PolicyError
from policies.external.readers import read, write_toml
from policies.external.spec import HeightGrid, PolicySpec, SpecTerm

pytest.importorskip("yaml")
pytest.importorskip("onnx")

from tests.policies.external.readers import files
from tests.policies.external.readers.files import (
    ISAAC,
    JOINT_VALUES,
    MOTORS,
    joint_values,
    network,
    permutation,
    write_settings,
)


def described(file: Path) -> PolicySpec:
    """Return the specification of a file; the specification equals the one of the TOML written from it."""
    found = read(file)
    assert found is not None
    write_toml(found, file.with_name("again.toml"))
    assert read(file.with_name("again.toml")) == found
    assert found.joints != found.observed_joints
    return found


@pytest.mark.parametrize("seed", range(3))
def test_unitree_gains_are_by_motor_and_all_else_by_joint(tmp_path: Path, seed: int) -> None:
    found = files.deploy(ids := permutation(seed))
    found["observations"]["joint_vel_rel"] |= {
        "scale": joint_values(MOTORS),
        "clip": [-10.0, 10.0],
        "history_length": 3,
    }
    found["actions"]["JointPositionAction"] |= {
        "offset": None,
        "clip": [[-each, each] for each in joint_values(MOTORS)],
    }
    policy = described(write_settings(tmp_path / "params/deploy.yaml", found)) if network(tmp_path) else None
    joints = tuple(MOTORS[each] for each in ids)
    assert policy is not None
    assert policy.network == tmp_path / "exported/policy.onnx"
    assert policy.joints == joints
    assert policy.stiffness == tuple(joint_values(joints, 20.0))
    assert policy.damping == tuple(joint_values(joints, 0.5))
    assert policy.default_position == tuple(joint_values(joints))
    assert policy.action_scale == tuple(joint_values(joints, 0.25))
    assert policy.action_offset == (0.0,) * 12
    assert policy.target_clip == tuple((-each, each) for each in joint_values(MOTORS))
    assert policy.control_rate == pytest.approx(50)
    names = [term.name for term in policy.terms]
    assert names[:3] == ["angular_velocity", "projected_gravity", "command"]
    assert names[3:] == ["joint_position", "joint_velocity", "previous_action"]
    assert policy.terms[4] == SpecTerm("joint_velocity", tuple(joint_values(MOTORS)), (-10.0, 10.0), 3)
    assert (policy.history_layout, policy.history_newest, policy.history_start) == ("term", "last", "first")


def test_unitree_actions_and_observations_may_have_other_orders(tmp_path: Path) -> None:
    found = files.deploy(list(range(12)))
    found["actions"]["JointPositionAction"]["joint_ids"] = order = permutation(1)
    for name in ("joint_pos_rel", "joint_vel_rel"):
        found["observations"][name]["params"] = {"asset_cfg": {"joint_ids": permutation(2)}}
    network(tmp_path, "policy.onnx")
    policy = described(write_settings(tmp_path / "deploy.yaml", found))
    assert policy.joints == tuple(MOTORS[each] for each in order)
    assert policy.stiffness == tuple(joint_values(policy.joints, 20.0))
    assert policy.default_position == tuple(joint_values(policy.joints))
    assert policy.observed_joints == tuple(MOTORS[each] for each in permutation(2))


def test_unitree_history_by_time_scales_before_clips_and_a_gait_clock(tmp_path: Path) -> None:
    found = files.deploy(permutation(0))
    for term in found["observations"].values():
        term["history_length"] = 4
    found["observations"]["base_ang_vel"] |= {"scale": [0.25] * 3, "clip": [-1.0, 1.0]}
    found["observations"]["gait_phase"] = {"params": {"period": 0.8}, "clip": None, "scale": None, "history_length": 4}
    found["observations"] |= {"use_gym_history": True, "scale_first": True}
    network(tmp_path)
    policy = described(
        write_settings(tmp_path / "params/deploy.yaml", {**found, "observations": {"obs": found["observations"]}})
    )
    assert policy.history_layout == "time"
    assert policy.terms[0] == SpecTerm("angular_velocity", (0.25,), (-4.0, 4.0), 4)
    assert policy.terms[-1] == SpecTerm("gait_clock", history=4, clock=1.25)


@pytest.mark.parametrize(
    ("name", "params", "threshold"),
    [
        ("gait_phase", {"period": 0.5}, 0.0),
        ("gait_phase", {"period": 0.5, "command_name": "twist"}, 0.1),
        ("gait_phase", {"period": 0.5, "command_name": "twist", "command_threshold": 0.05}, 0.05),
        ("gait_phase_my", {"period": 0.5}, 0.1),
        ("phase", {"cycle_time": 0.5}, 0.0),
        ("phase", {"period": 0.5, "command_name": "twist"}, 0.1),
    ],
)
def test_a_clock_stops_at_small_commands_where_the_file_says_so(
    tmp_path: Path, name: str, params: dict[str, Any], threshold: float
) -> None:
    found = files.deploy(permutation(0))
    found["observations"][name] = {"params": params, "clip": None, "scale": None, "history_length": 1}
    network(tmp_path)
    policy = described(write_settings(tmp_path / "params/deploy.yaml", found))
    assert policy.terms[-1] == SpecTerm("gait_clock", clock=2.0, zero_below=threshold)
    assert any("`zero_below = 0.1` in a TOML" in remark for remark in policy.remarks) is (threshold == 0.0)


def test_isaac_lab_joints_are_by_kind_and_gains_by_expression(tmp_path: Path) -> None:
    network(tmp_path)
    policy = described(write_settings(tmp_path / "params/env.yaml", files.env()))
    assert policy.joints == ISAAC
    assert policy.stiffness == (20.0,) * 4 + (30.0,) * 4 + (40.0,) * 4
    assert policy.damping == (0.5,) * 4 + (1.0,) * 8
    assert policy.default_position == (0.1, 0.0, 0.1, 0.0, 0.8, 0.8, 0.0, 0.0) + (-1.5,) * 4
    assert policy.action_scale == (0.125,) * 4 + (0.25,) * 8
    assert (policy.action_offset, policy.action_clip, policy.observed_joints) == (None, None, None)
    assert [term.name for term in policy.terms][2:4] == ["command", "joint_position"]


def test_isaac_lab_keeps_an_order_that_names_give(tmp_path: Path) -> None:
    found = files.env()
    found["actions"]["joint_pos"] |= {"joint_names": list(MOTORS), "preserve_order": True, "clip": {".*": [-9.0, 9.0]}}
    found["actions"]["joint_pos"] |= {"use_default_offset": False, "offset": {".*_hip_joint": 0.5}}
    found["observations"]["policy"]["history_length"] = 5
    network(tmp_path)
    network(tmp_path, "exported/policy.pt")
    write_settings(tmp_path / "params/agent.yaml", {"clip_actions": 6.0})
    policy = described(write_settings(tmp_path / "params/env.yaml", found))
    assert (policy.joints, policy.observed_joints) == (MOTORS, ISAAC)
    assert policy.target_clip == ((-9.0, 9.0),) * 12
    assert policy.action_clip == (-6.0, 6.0)
    assert policy.action_offset == (0.5, 0.0, 0.0) * 4
    assert policy.stiffness == (20.0, 30.0, 40.0) * 4
    assert {term.history for term in policy.terms} == {5}
    assert policy.network.name == "policy.onnx"
    found["actions"]["joint_pos"]["preserve_order"] = False
    assert described(write_settings(tmp_path / "params/env.yaml", found)).joints == ISAAC


def test_isaac_sims_samples_have_their_network_next_to_them_by_name(tmp_path: Path) -> None:
    found = network(tmp_path, "dog_policy.pt")
    network(tmp_path, "cat_policy.pt")
    assert described(write_settings(tmp_path / "dog_env.yaml", files.env())).network == found


def test_isaac_lab_height_scan_has_the_grid_of_its_sensor(tmp_path: Path) -> None:
    found = files.env()
    scan = {"func": "isaaclab.envs.mdp.observations:height_scan", "params": {"sensor_cfg": {"name": "scanner"}}}
    found["observations"]["policy"]["height_scan"] = scan | {"clip": [-1.0, 1.0], "scale": 5.0}
    pattern = {"resolution": 0.1, "size": [0.2, 0.4], "ordering": "xy"}
    found["scene"]["scanner"] = {"ray_alignment": "yaw", "pattern_cfg": pattern, "offset": {"pos": [0.5, 0.0, 20.0]}}
    network(tmp_path)
    (*_, term) = described(write_settings(tmp_path / "params/env.yaml", found)).terms
    assert term.grid == HeightGrid((0.4, 0.5, 0.6), (-0.2, -0.1, 0.0, 0.1, 0.2), x_first=True, offset=0.5)
    assert (term.scale, term.clip, term.width) == ((5.0,), (-1.0, 1.0), 15)


def test_tuples_and_slices_of_python_are_read_as_data(tmp_path: Path) -> None:
    network(tmp_path)
    file = write_settings(tmp_path / "params/env.yaml", files.env())
    plain = read(file)
    text = file.read_text()
    text = text.replace(
        "      params: {}",
        "      params: {asset_cfg: {joint_ids: !!python/object/apply:builtins.slice [null, null, null]}}",
    )
    file.write_text(f"{text}\nviewer:\n  eye: !!python/tuple\n  - 7.5\n")
    assert read(file) == plain


@pytest.mark.parametrize("seed", range(3))
def test_rl_sar_joints_are_the_bases_motors_by_the_mapping(tmp_path: Path, seed: int) -> None:
    config, base = files.rl_sar(permutation(seed))
    write_settings(tmp_path / "go2/base.yaml", base)
    network(tmp_path, "go2/robot_lab/policy.pt")
    policy = described(write_settings(tmp_path / "go2/robot_lab/config.yaml", config))
    joints = tuple(MOTORS[each] for each in permutation(seed))
    assert policy.joints == joints
    assert policy.stiffness == tuple(joint_values(joints, 20.0))
    assert policy.default_position == tuple(joint_values(joints))
    assert policy.control_rate == pytest.approx(50)
    assert policy.terms[0] == SpecTerm("command", (2.0, 2.0, 0.25), history=3)
    assert (policy.action_clip, policy.observation_clip) == ((-50.0, 50.0), 100.0)
    assert (policy.history_layout, policy.history_newest, policy.history_start) == ("time", "first", "zero")


def test_an_rl_sar_file_without_base_names_the_joints_in_the_policys_order(tmp_path: Path) -> None:
    config, _ = files.rl_sar(list(range(12)))
    own = config["go2/robot_lab"]
    del own["joint_mapping"]
    own |= {"joint_controller_names": [name.replace("_joint", "_controller") for name in ISAAC], "dt": 0.005}
    own |= {"decimation": 4, "observations_history": [2, 1, 0], "observations_history_priority": "term"}
    network(tmp_path, "policy.pt")
    policy = described(write_settings(tmp_path / "config.yaml", config))
    assert policy.joints == ISAAC
    assert (policy.history_layout, policy.history_newest) == ("term", "last")


def rl_sar_before_v2_3(reduction: float = 1.0, framework: str = "isaacgym") -> dict[str, Any]:
    """Return settings in the format of rl_sar up to v2.2: joints by leg, and a history that starts at its end."""
    config, _ = files.rl_sar(list(range(12)))
    own = config["go2/robot_lab"]
    for key in ("joint_mapping", "observations_history_priority", "dt", "decimation"):
        own.pop(key, None)
    names = [name.replace("_joint", "_controller") for name in MOTORS]
    own |= {"framework": framework, "rows": 4, "cols": 3, "dt": 0.005, "decimation": 4, "action_scale": 0.25}
    own |= {"joint_controller_names": names, "observations_history": [5, 4, 3, 2, 1, 0]}
    own |= {"hip_scale_reduction": reduction, "hip_scale_reduction_indices": [0, 3, 6, 9]}
    return {"go2_isaacgym": own}


def test_a_history_of_rl_sar_before_v2_3_is_walked_through_from_its_end(tmp_path: Path) -> None:
    network(tmp_path, "policy.pt")
    settings = rl_sar_before_v2_3()
    policy = described(write_settings(tmp_path / "config.yaml", settings))
    assert (policy.history_newest, policy.terms[0].history) == ("first", 6)
    assert policy.action_scale == (0.25,) * 12
    settings["go2_isaacgym"]["observations_history"].reverse()
    assert described(write_settings(tmp_path / "config.yaml", settings)).history_newest == "last"


def test_hips_of_rl_sar_before_v2_3_are_reduced_and_shown_so(tmp_path: Path) -> None:
    network(tmp_path, "policy.pt")
    policy = described(write_settings(tmp_path / "config.yaml", rl_sar_before_v2_3(0.5)))
    assert policy.action_scale == (0.125, 0.25, 0.25) * 4
    assert policy.terms[-1] == SpecTerm("previous_action", (0.5, 1.0, 1.0) * 4, history=6)
    assert policy.terms[3] == SpecTerm("joint_position", history=6)


def test_joints_of_rl_sar_before_v2_3_are_transposed_for_isaac_sim(tmp_path: Path) -> None:
    network(tmp_path, "policy.pt")
    settings = rl_sar_before_v2_3(framework="isaacsim")
    policy = described(write_settings(tmp_path / "config.yaml", settings))
    by_kind = tuple(f"{leg}_{kind}" for kind in files.KINDS for leg in files.LEGS)
    assert policy.joints == by_kind
    assert policy.default_position == tuple(joint_values(by_kind))
    assert policy.stiffness == tuple(joint_values(by_kind, 20.0))


def test_keys_of_both_ages_of_rl_sar_are_read_as_the_newer_or_refused(tmp_path: Path) -> None:
    config, base = files.rl_sar(permutation(0))
    write_settings(tmp_path / "go2/base.yaml", base)
    network(tmp_path, "go2/robot_lab/policy.pt")
    config["go2/robot_lab"]["hip_scale_reduction"] = 1.0
    assert described(write_settings(tmp_path / "go2/robot_lab/config.yaml", config)).history_newest == "first"
    config["go2/robot_lab"]["hip_scale_reduction"] = 0.5
    with pytest.raises(PolicyError, match=r"hip_scale_reduction.* in `action_scale`, joint by joint"):
        read(write_settings(tmp_path / "go2/robot_lab/config.yaml", config))


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
def test_legged_gym_joints_are_in_isaac_gyms_order(tmp_path: Path, suffix: str) -> None:
    network(tmp_path, "exported/policies/policy_1.pt")
    found = files.legged_gym()
    found["terrain"]["measure_heights"], found["env"]["num_observations"] = True, 48 + 6
    policy = described(write_settings(tmp_path / f"settings{suffix}", found))
    assert policy.joints == tuple(f"{leg}_{kind}" for leg in ("FL", "FR", "RL", "RR") for kind in files.KINDS)
    assert policy.default_position == tuple(JOINT_VALUES[name] for name in policy.joints)
    assert policy.stiffness == (20.0, 30.0, 40.0) * 4
    assert policy.terms[0] == SpecTerm("linear_velocity", (2.0,))
    assert policy.terms[3] == SpecTerm("command", (2.0, 2.0, 0.25))
    grid = HeightGrid((-0.1, 0.0, 0.1), (0.0, 0.2), x_first=False, offset=0.5)
    assert policy.terms[-1] == SpecTerm("height_scan", (5.0,), (-1.0, 1.0), grid=grid)
    assert (policy.width, policy.action_clip) == (54, (-50.0, 50.0))


def test_legged_gyms_gains_are_those_of_the_last_key_in_the_joints_name(tmp_path: Path) -> None:
    network(tmp_path, "policy.pt")
    found = files.legged_gym()
    found["control"]["stiffness"] = {"joint": 20.0, "calf_joint": 40.0, "RL_calf": 60.0}
    found["control"]["damping"] = {"RL_calf": 3.0, "calf_joint": 1.0, "joint": 0.5}
    policy = described(write_settings(tmp_path / "settings.json", found))
    expected = {name: (40.0, 1.0) if "calf" in name else (20.0, 0.5) for name in policy.joints}
    expected["RL_calf_joint"] = (60.0, 3.0)
    assert dict(zip(policy.joints, zip(policy.stiffness, policy.damping, strict=True), strict=True)) == expected


def test_himloco_shows_six_steps_the_newest_first_and_scales_hips_less(tmp_path: Path) -> None:
    found = files.legged_gym()
    found["env"] = {"num_observations": 270, "num_one_step_observations": 45}
    found["control"]["hip_reduction"] = 0.5
    network(tmp_path, "policy.pt")
    policy = described(write_settings(tmp_path / "settings.yaml", found))
    assert policy.terms[0] == SpecTerm("command", (2.0, 2.0, 0.25), history=6)
    assert (policy.history_layout, policy.history_newest, policy.history_start) == ("time", "first", "zero")
    assert policy.action_scale == (0.125, 0.25, 0.25) * 4
    assert policy.width == 270


@pytest.mark.parametrize("key", ["hip_reduction", "hip_scale_reduction"])
def test_either_key_of_legged_gym_s_offspring_scales_hips_less(tmp_path: Path, key: str) -> None:
    found = files.legged_gym()
    found["control"] |= {key: 0.4}
    network(tmp_path, "policy.pt")
    policy = described(write_settings(tmp_path / "settings.yaml", found))
    assert policy.action_scale == pytest.approx((0.1, 0.25, 0.25) * 4)


@pytest.mark.parametrize("seed", range(2))
def test_mjlab_metadata_is_in_the_order_of_its_joints(tmp_path: Path, seed: int) -> None:
    names = tuple(MOTORS[each] for each in permutation(seed))
    policy = described(files.onnx_file(tmp_path / "policy.onnx", files.mjlab(names)))
    assert policy.joints == names
    assert policy.stiffness == tuple(joint_values(names, 20.0))
    assert policy.damping == policy.default_position == tuple(joint_values(names))
    assert policy.action_scale == tuple(joint_values(names, 2.0))
    assert policy.terms[3] == SpecTerm("joint_position")
    assert (policy.control_rate, policy.width) == (50.0, 48)


def test_mjlab_terms_may_have_scales_clips_and_histories(tmp_path: Path) -> None:
    metadata = files.mjlab(MOTORS) | {
        "observation_names": "base_ang_vel,joint_pos",
        "observation_terms_scale": "0.250,[1.0, 2.0, 3.0, 1.0, 2.0, 3.0, 1.0, 2.0, 3.0, 1.0, 2.0, 3.0]",
        "observation_terms_clip": "[-inf, inf],[-1.0, 1.0]",
        "observation_terms_history_length": "0.000,3.000",
        "action_scale": "0.5",
    }
    policy = described(files.onnx_file(tmp_path / "policy.onnx", metadata))
    assert policy.terms == (
        SpecTerm("angular_velocity", (0.25,)),
        SpecTerm("joint_position", (1.0, 2.0, 3.0) * 4, (-1.0, 1.0), 3),
    )
    assert policy.action_scale == (0.5,) * 12


def test_lists_within_the_lists_of_newer_mjlab_have_semicolons(tmp_path: Path) -> None:
    metadata = files.mjlab(MOTORS) | {
        "observation_names": "base_ang_vel,command",
        "observation_terms_scale": "0.250,2.000;2.000;0.250",
        "observation_terms_clip": "-inf;inf,-1.000;1.000",
        "observation_terms_history_length": "0,3",
        "observation_terms_flatten_history_dim": "True,True",
    }
    policy = described(files.onnx_file(tmp_path / "policy.onnx", metadata))
    assert policy.terms == (
        SpecTerm("angular_velocity", (0.25,)),
        SpecTerm("command", (2.0, 2.0, 0.25), (-1.0, 1.0), 3),
    )


def test_an_onnx_file_without_metadata_describes_nothing(tmp_path: Path) -> None:
    assert read(files.onnx_file(tmp_path / "policy.onnx", {"joint_names": "a,b"})) is None
    assert read(tmp_path / "mine.py") is None
