"""Deployment files: each format describes the policy that was exported, and names what it cannot describe."""

import contextlib
import runpy
import warnings
from pathlib import Path

import gymnasium as gym
import mujoco
import numpy as np
import pytest
import torch
import yaml
from onnxruntime import InferenceSession

from policies import bundle
from policies.base import PolicyError
from policies.external.joint_mapping import map_joints
from policies.external.onnx_network import read_metadata
from policies.history import Inputs
from policies.input_terms import DEPLOYABLE_TERMS
from policies.residual import NO_HISTORY, ResidualPolicy
from policies.trot.open_loop import Trot
from quad_env.robots.registry import get_robot
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.task.observations import observation_table
from tests.train.export.plain_policies import ExactNetwork, make_policy
from train.export.export import FORMATS, export, largest_difference, read_back

ROBOTS = ("simple_quad", "go2")
TOLERANCE = 1e-6
"""Largest difference of the joint targets, rad."""
CLOCKS = ("unitree", "isaac-lab", "toml")
"""Formats with a clock and with a history that starts with the first observation."""
MEASURED = ("unitree", "rl-sar")
"""Formats of programs that have no linear velocity."""


def turned_robot(folder: Path) -> Robot:
    """Return SimpleQuad as a user's model in which thighs turn the other way and calves have another zero."""
    spec = mujoco.MjSpec.from_file(str(SIMPLE_QUAD.mjcf))
    for joint in spec.joints:
        if "thigh" in joint.name:
            joint.axis = -joint.axis
            joint.range = -joint.range[::-1]
    path = folder / "turned.xml"
    path.write_text(spec.to_xml(), encoding="utf-8")
    return Robot.from_mjcf(path)


def difference(policy: ResidualPolicy, to: str, folder: Path) -> float:
    """Export a policy, and return its largest difference from the policy that is read back."""
    export(policy, "mine", to, folder)
    copy = read_back(policy, folder / FORMATS[to].settings)
    np.testing.assert_allclose(copy.robot.gains, policy.robot.gains, rtol=1e-9)
    return largest_difference(policy, copy)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("to", FORMATS)
def test_the_policy_read_back_has_the_same_targets(to: str, robot: str, tmp_path: Path) -> None:
    ignored = ("linear_velocity",) if to in MEASURED else ()
    policy = make_policy(get_robot(robot), NO_HISTORY, ignored=ignored)
    assert difference(policy, to, tmp_path / "out") < TOLERANCE


@pytest.mark.parametrize("hold", [1, 2])
@pytest.mark.parametrize("to", CLOCKS)
def test_a_clock_and_a_history_are_read_back(to: str, hold: int, tmp_path: Path) -> None:
    inputs = Inputs(clock=2.2, lags=(0.02, 0.06))
    policy = make_policy(get_robot("go2"), inputs, ignored=("linear_velocity",), hold=hold, crouches=False)
    assert difference(policy, to, tmp_path / "out") < TOLERANCE


@pytest.mark.parametrize("history", [1, 5])
@pytest.mark.parametrize("to", CLOCKS)
def test_a_policy_with_the_terms_of_a_robot_is_read_back(to: str, history: int, tmp_path: Path) -> None:
    inputs = Inputs(clock=2.2, terms=DEPLOYABLE_TERMS, history=history)
    policy = make_policy(get_robot("go2"), inputs, crouches=False)
    assert difference(policy, to, tmp_path / "out") < TOLERANCE


@pytest.mark.parametrize(("to", "history"), [("mjlab", 5), ("rl-sar", 1)])
def test_a_policy_with_the_terms_of_a_robot_and_no_clock_is_read_back(to: str, history: int, tmp_path: Path) -> None:
    policy = make_policy(get_robot("go2"), Inputs(terms=DEPLOYABLE_TERMS, history=history))
    assert difference(policy, to, tmp_path / "out") < TOLERANCE


def test_a_history_without_a_clock_is_read_back_from_mjlab(tmp_path: Path) -> None:
    policy = make_policy(SIMPLE_QUAD, Inputs(lags=(0.02, 0.04)))
    assert difference(policy, "mjlab", tmp_path / "out") < TOLERANCE


@pytest.mark.parametrize("to", FORMATS)
def test_signs_of_the_model_file_are_those_of_the_policy_file(to: str, tmp_path: Path) -> None:
    robot = turned_robot(tmp_path)
    assert set(map_joints(robot.joint_names, robot).signs) == {1.0, -1.0}
    policy = make_policy(robot, NO_HISTORY, ignored=("linear_velocity",), bounded=False)
    assert difference(policy, to, tmp_path / "out") < TOLERANCE


@pytest.mark.parametrize("bounded", [True, False])
def test_a_joint_that_is_never_corrected_keeps_its_base_pose(bounded: bool, tmp_path: Path) -> None:
    policy = make_policy(SIMPLE_QUAD, NO_HISTORY, bounded=bounded)
    policy.authority[::3] = 0.0
    assert difference(policy, "toml", tmp_path / "out") < TOLERANCE


@pytest.mark.parametrize(
    ("to", "torchscript"), [("isaac-lab", "exported/policy.pt"), ("rl-sar", "simple_quad/policy.pt")]
)
def test_both_network_files_of_an_export_are_one_network(to: str, torchscript: str, tmp_path: Path) -> None:
    ignored = ("linear_velocity",) if to in MEASURED else ()
    export(make_policy(SIMPLE_QUAD, NO_HISTORY, ignored=ignored), "mine", to, tmp_path / "out")
    session = InferenceSession(tmp_path / "out" / FORMATS[to].onnx)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        module = torch.jit.load(tmp_path / "out" / torchscript)
    width = session.get_inputs()[0].shape[1]
    observations = np.random.default_rng(0).standard_normal((20, 1, width)).astype(np.float32)
    for observation in observations:
        (actions,) = session.run(None, {"obs": observation})
        np.testing.assert_allclose(module(torch.from_numpy(observation)).numpy(), actions, atol=TOLERANCE)


@pytest.mark.parametrize("history", [1, 4])
@pytest.mark.parametrize("to", CLOCKS)
def test_a_clock_that_is_hidden_at_rest_is_read_back(to: str, history: int, tmp_path: Path) -> None:
    terms = ("command", "joint_position", "projected_gravity")
    inputs = Inputs(clock=2.2, clock_at_rest="hidden", terms=terms, history=history)
    policy = make_policy(SIMPLE_QUAD, inputs)
    assert difference(policy, to, tmp_path / "out") < TOLERANCE
    copy = read_back(policy, tmp_path / "out" / FORMATS[to].settings)
    # The command stops and starts within the history.
    for each in (policy, copy):
        each.reset(1, 0)
    for step in range(40):
        observation = np.zeros((1, 48), np.float32)
        observation[0, -3:] = (0.0, 0.0, -0.2) if step % 12 < 6 else 0.0
        np.testing.assert_allclose(copy.act(observation), policy.act(observation), atol=TOLERANCE)


def test_a_clock_is_hidden_at_rest_if_the_network_ignores_the_command(tmp_path: Path) -> None:
    inputs = Inputs(clock=2.2, clock_at_rest="hidden", lags=(0.02,))
    policy = make_policy(get_robot("go2"), inputs, ignored=("linear_velocity", "command"))
    assert difference(policy, "unitree", tmp_path / "out") < TOLERANCE


def test_a_clock_that_is_hidden_by_no_command_is_refused(tmp_path: Path) -> None:
    inputs = Inputs(clock=2.2, clock_at_rest="hidden", terms=("joint_position",))
    with pytest.raises(
        PolicyError, match=r"--to unitree: clock at rest \(clock_at_rest\): .* got hidden; valid: shown"
    ):
        export(make_policy(SIMPLE_QUAD, inputs), "mine", "unitree", tmp_path / "out")


ALL_INPUTS = Inputs((0.01, 0.02, 0.04), (0.3, 1.5), clock=2.2, clock_gain=0.6, clock_limit=2.0, position_error=0.5)


@pytest.mark.parametrize("hold", [1, 2])
def test_the_toml_has_lags_averages_position_errors_and_a_faster_clock(hold: int, tmp_path: Path) -> None:
    policy = make_policy(get_robot("go2"), ALL_INPUTS, hold=hold)
    assert difference(policy, "toml", tmp_path / "out") < TOLERANCE


def test_a_robot_that_is_reset_alone_has_a_past_of_its_own(tmp_path: Path) -> None:
    policy = make_policy(SIMPLE_QUAD, ALL_INPUTS)
    export(policy, "mine", "toml", tmp_path / "out")
    copy = read_back(policy, tmp_path / "out/policy.toml")
    random = np.random.default_rng(0)
    table = observation_table(SIMPLE_QUAD)
    observation = np.zeros((3, table.size), np.float32)
    previous = np.zeros((3, 12), np.float32)
    for each in (policy, copy):
        each.reset(3, 0)
    for step in range(60):
        observation[:] = random.standard_normal(observation.shape) / (2.0 * table.scale)
        observation[:, table.slices["command"]] = (0.3, -0.2, 0.1)
        observation[:, table.slices["previous_action"]] = previous
        action = policy.act(observation)
        np.testing.assert_allclose(copy.act(observation), action, atol=TOLERANCE)
        previous = action - SIMPLE_QUAD.home_pose.astype(np.float32)
        if step in (17, 40):
            mask = np.arange(3) == step % 3
            policy.reset_where(mask)
            copy.reset_where(mask)
            previous[mask] = 0.0


@pytest.mark.parametrize("inputs", [ALL_INPUTS, Inputs(clock=2.2, lags=(0.02, 0.06))], ids=["toml", "history"])
def test_the_program_of_an_export_observes_as_the_readers_do(inputs: Inputs, tmp_path: Path) -> None:
    policy = make_policy(get_robot("go2"), inputs, crouches=False)
    to = "toml" if inputs.averages else "isaac-lab"
    export(policy, "mine", to, tmp_path / "out")
    copy = read_back(policy, tmp_path / "out" / FORMATS[to].settings)
    copy.reset(1, 0)
    program = runpy.run_path(str(tmp_path / "out/run.py"))
    model = program["MODEL"]
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    command = np.array([0.6, 0.1, -0.4])
    observer = program["Observer"](command)
    previous = np.zeros(12)
    for step in range(30):
        mujoco.mj_forward(model, data)
        axes = data.xmat[program["TRUNK"]].reshape(3, 3)
        joints = data.qpos[7:] - policy.robot.home_pose
        motion = (-axes[2], data.qvel[3:6], data.qvel[:3] @ axes, joints, data.qvel[6:], previous, command)
        action = copy.act(np.concatenate(motion)[None].astype(np.float32))[0]
        seen = observer.observe(data)
        if step % policy.hold == 0:
            observer.action = program["SESSION"].run(None, {"obs": seen})[0][0].astype(float)
        data.ctrl[:] = action
        signs = program["SIGNS"]
        targets = program["ZEROS"] + signs * (program["DEFAULT"] + program["SCALE"] * observer.action)
        np.testing.assert_allclose(targets, action, atol=1e-5)
        previous = action - policy.robot.home_pose
        mujoco.mj_step(model, data, 5)


@pytest.mark.parametrize("scenario", ["flat", "push"])
def test_the_policy_read_back_walks_as_the_shipped_policy(scenario: str, tmp_path: Path, repository: Path) -> None:
    policy = bundle.load(repository / "models/end_to_end")
    export(policy, "end_to_end", "toml", tmp_path / "out")
    copy = read_back(policy, tmp_path / "out/policy.toml")
    with contextlib.closing(gym.make_vec("SimpleQuad-v0", num_envs=3, robot=policy.robot, scenario=scenario)) as env:
        observation, _ = env.reset(seed=1, options={"command": (0.5, 0.0, 0.0)})
        for each in (policy, copy):
            each.reset(3, 0)
        velocities = []
        for _ in range(200):
            action = copy.act(observation)
            np.testing.assert_allclose(policy.act(observation), action, atol=3 * TOLERANCE)
            observation, _, terminated, _, info = env.step(action)
            assert not terminated.any()
            velocities.append(info["heading_velocity"][:, 0])
    np.testing.assert_allclose(np.mean(velocities[100:], axis=0), 0.5, atol=0.15)


@pytest.mark.parametrize("to", sorted({*FORMATS} - {*MEASURED}))
def test_the_shipped_policy_without_a_clock_weight_is_exported(to: str, tmp_path: Path, repository: Path) -> None:
    policy = bundle.load(repository / "models/end_to_end")
    weights = policy.network.weights[0].copy()
    weights[policy.features.columns["clock"]] = 0.0
    policy.network = ExactNetwork((weights, *policy.network.weights[1:]), policy.network.biases)
    assert difference(policy, to, tmp_path / "out") < 3 * TOLERANCE


def test_unitree_s_file_has_gains_by_motor_and_values_by_joint(tmp_path: Path) -> None:
    policy = make_policy(get_robot("go2"), Inputs(clock=2.0, lags=(0.02,)), ignored=("linear_velocity",))
    export(policy, "mine", "unitree", tmp_path / "out")
    written = yaml.safe_load((tmp_path / "out/params/deploy.yaml").read_text(encoding="utf-8"))
    # In Unitree's SDK the motors are front right, front left, rear right, rear left.
    motors = [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8]
    assert written["joint_ids_map"] == motors
    assert written["stiffness"] == policy.robot.servo_stiffness[motors].tolist()
    assert written["damping"] == policy.robot.servo_damping[motors].tolist()
    action = written["actions"]["JointPositionAction"]
    assert action["scale"] == policy.authority.astype(float).tolist()
    assert action["offset"] == written["default_joint_pos"]
    assert written["step_dt"] == pytest.approx(0.02)
    terms = written["observations"]
    assert {term["history_length"] for name, term in terms.items() if name != "gait_phase"} == {2}
    assert terms["gait_phase"]["params"] == {"period": 0.5}
    assert {"lin_vel_x", "lin_vel_y", "ang_vel_z"} < written["commands"]["base_velocity"]["ranges"].keys()


def exported(policy: ResidualPolicy, to: str, folder: Path) -> Path:
    """Export a policy to a new folder, and return the folder."""
    export(policy, "mine", to, folder / "out")
    return folder / "out"


@pytest.mark.parametrize("robot", ROBOTS)
def test_isaac_sim_finds_what_its_controller_reads(robot: str, tmp_path: Path) -> None:
    policy = make_policy(get_robot(robot), Inputs(terms=DEPLOYABLE_TERMS), crouches=False)
    folder = exported(policy, "isaac-lab", tmp_path)
    written = yaml.safe_load((folder / "params/env.yaml").read_text(encoding="utf-8"))["scene"]["robot"]
    # `PolicyController.initialize` reads a mapping here, and sets the armature to 0 if the file has none.
    assert isinstance(written["spawn"]["articulation_props"]["enabled_self_collisions"], bool)
    model = mujoco.MjModel.from_xml_path(str(folder / "scene.xml"))
    armature = {name: model.dof_armature[model.joint(name).dofadr[0]] for name in policy.robot.joint_names}
    assert written["actuators"]["legs"]["armature"] == pytest.approx(armature)
    assert min(armature.values()) > 0.0


@pytest.mark.parametrize(("history", "text"), [(1, "0.000"), (5, "5.000")])
def test_a_single_step_is_no_history_in_mjlab(history: int, text: str, tmp_path: Path) -> None:
    folder = exported(make_policy(SIMPLE_QUAD, Inputs(terms=DEPLOYABLE_TERMS, history=history)), "mjlab", tmp_path)
    metadata = read_metadata(folder / "policy.onnx")
    assert metadata["observation_terms_history_length"].split(",") == [text] * len(DEPLOYABLE_TERMS)


def test_rl_sar_has_the_gains_of_both_modes_in_the_order_of_the_policy(tmp_path: Path) -> None:
    folder = exported(make_policy(get_robot("go2"), Inputs(terms=DEPLOYABLE_TERMS)), "rl-sar", tmp_path)
    (written,) = yaml.safe_load((folder / "simple_quad/config.yaml").read_text(encoding="utf-8")).values()
    assert written["fixed_kp"] == written["rl_kp"]
    assert written["fixed_kd"] == written["rl_kd"]


@pytest.mark.parametrize(
    ("to", "words"),
    [("rl-sar", ('config_name = "simple_quad"', "fsm_go2.hpp")), ("unitree", ("policy_dir", "go2_ctrl"))],
)
def test_the_readme_says_how_the_program_finds_the_policy(to: str, words: tuple[str, ...], tmp_path: Path) -> None:
    folder = exported(make_policy(get_robot("go2"), Inputs(terms=DEPLOYABLE_TERMS)), to, tmp_path)
    text = (folder / "README.md").read_text(encoding="utf-8")
    assert [word for word in words if word not in text] == []


IGNORES = {"ignored": ("linear_velocity",)}
REFUSALS = {
    "linear velocity": ("unitree", NO_HISTORY, {}, "observation term: .* no estimate of it, got linear_velocity"),
    "rl_sar velocity": ("rl-sar", NO_HISTORY, {}, "observation term: .* lin_vel, .* always 0, got linear_velocity"),
    "mjlab clock": ("mjlab", Inputs(clock=2.0), {}, "no parameter .* period, got gait_clock; .* unitree, isaac-lab"),
    "mjlab rate": ("mjlab", NO_HISTORY, {"hold": 1}, "control rate: .* got 100 Hz; valid: 50 Hz"),
    "rl_sar clock": ("rl-sar", Inputs(clock=2.0), IGNORES, "motion_length, .* got gait_clock; .* unitree, isaac-lab"),
    "rl_sar history": ("rl-sar", Inputs(lags=(0.02,)), IGNORES, "starts with the first observation: .* got 2 steps"),
    "averages": ("mjlab", Inputs(averages=(0.3,)), {}, r"inputs.averages: only --to toml can say it, got \(0.3,\)"),
    "position error": ("rl-sar", Inputs(position_error=0.5), {}, "inputs.position_error: only --to toml .* got 0.5"),
    "clock gain": ("isaac-lab", Inputs(clock=2.0, clock_gain=0.6), {}, "inputs.clock_gain: only --to toml .* got 0.6"),
    "lag between actions": ("isaac-lab", Inputs(lags=(0.01,)), {}, "inputs.lags: only --to toml .* 0.02 s, got 0.01"),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_a_format_names_the_property_that_it_cannot_describe(case: str, tmp_path: Path) -> None:
    to, inputs, options, words = REFUSALS[case]
    with pytest.raises(PolicyError, match=words) as refusal:
        export(make_policy(SIMPLE_QUAD, inputs, **options), "mine", to, tmp_path / "out")
    assert "\n" not in str(refusal.value)
    assert not list(tmp_path.iterdir())


def test_a_residual_on_a_controller_is_refused_with_the_distillation(tmp_path: Path, repository: Path) -> None:
    policy = bundle.load(repository / "models/residual")
    assert isinstance(policy.base, Trot)
    with pytest.raises(PolicyError, match=r"corrects the controller trot.*python -m train --teacher models/residual"):
        export(policy, "models/residual", "toml", tmp_path / "out")


def test_a_failed_export_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("train.export.export.TOLERANCE", 0.0)
    policy = make_policy(SIMPLE_QUAD, NO_HISTORY)
    with pytest.raises(PolicyError, match=r"policy.toml: the joint targets read back differ .* by .* rad"):
        export(policy, "mine", "toml", tmp_path / "out")
    assert not list(tmp_path.iterdir())
