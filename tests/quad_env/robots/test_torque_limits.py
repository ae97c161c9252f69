"""The largest torque of a joint is the sum of its MuJoCo actuators, or a required parameter."""

import re
import warnings
from pathlib import Path

import mujoco
import numpy as np
import pytest

from quad_env import ModelError, Robot
from quad_env.actuation.models import Actuator, TorqueSpeed
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.physics.model import compile_model
from quad_env.scenarios.registry import SCENARIOS
from tests.quad_env.robots.made import Made
from tests.quad_env.robots.test_model_files import PLAIN, TRUNK, robot_of_text
from tests.quad_env.robots.test_read_urdf import urdf, written

LEGS = "ABCD"
FIXED = '<fixed name="{0}"><joint joint="{0}2" coef="2"/></fixed>'
CLAMPED = '<fixed name="{0}" actuatorfrcrange="-4 4"><joint joint="{0}2" coef="2"/></fixed>'
SPATIAL = '<spatial name="{0}"><site site="top"/><site site="{0}"/></spatial>'
PAIR = '<position joint="{0}2" kp="60" forcerange="-20 20"/><velocity joint="{0}2" kv="1" forcerange="-5 5"/>'
PULLS = '<motor joint="{0}2" ctrlrange="0 12"/><motor joint="{0}2" ctrlrange="0 12" gear="-1"/>'
GENERAL = '<general joint="{0}2" '
CABLE = '<motor tendon="{0}" ctrlrange="-6 6" gear="1.5"/>'
WINDING = '<dcmotor joint="{0}2" motorconst="0.1" resistance="1" ctrlrange="-24 24" '
DAMPED = '<motor joint="{0}2" ctrlrange="-6 6"/><damper joint="{0}2" kv="3" ctrlrange="0 1" '
KNEES = {  # actuators of each knee, tendons, N·m
    "two that add": (PAIR, "", 25.0),
    "a gear": ('<motor joint="{0}2" gear="-3" forcerange="-5 5"/>', "", 15.0),
    "one pulls and one pushes": (PULLS, "", 12.0),
    "gain and control": (GENERAL + 'gainprm="4" ctrlrange="-3 3"/>', "", 12.0),
    "gain, control and limit": (GENERAL + 'gainprm="4" ctrlrange="-3 3" forcerange="-7 9"/>', "", 7.0),
    "a constant bias": (GENERAL + 'ctrlrange="-9 9" biastype="affine" biasprm="2 0 0"/>', "", 7.0),
    "a filter": (GENERAL + 'dyntype="filter" dynprm="0.1" ctrlrange="-9 9"/>', "", 9.0),
    "an integrator": (GENERAL + 'dyntype="integrator" actrange="-8 8" ctrlrange="-1 1"/>', "", 8.0),
    "in the parent's frame": ('<motor jointinparent="{0}2" ctrlrange="-6 6"/>', "", 6.0),
    "several inputs": ('<pid joint="{0}2" kp="9" input="pos vel ff" forcerange="-11 11"/>', "", 11.0),
    "a tendon": ('<motor tendon="{0}" ctrlrange="-6 6"/>', FIXED, 12.0),
    "a tendon with a limit": (CABLE, CLAMPED, 12.0),
    "a tendon with a limit of two motors": (CABLE + '<motor tendon="{0}" ctrlrange="-2 2"/>', CLAMPED, 14.0),
    "a tendon and a motor": (
        '<motor tendon="{0}" ctrlrange="-6 6"/><motor joint="{0}2" ctrlrange="-3 3"/>',
        FIXED,
        15.0,
    ),
    "a damper beside a motor": (DAMPED + "/>", "", 6.0),
    "a damper with a limit": (DAMPED + 'forcerange="-2 2"/>', "", 6.0),
    "saturation": (WINDING + 'saturation="7 0 0"/>', "", 7.0),
}
UNKNOWN = {
    "a servo without a limit": ('<position joint="{0}2" kp="60"/>', ""),
    "one with and one without": ('<motor joint="{0}2" ctrlrange="-9 9"/><position joint="{0}2" kp="60"/>', ""),
    "an unlimited integrator": (GENERAL + 'dyntype="integrator" ctrlrange="-1 1"/>', ""),
    "a motor without a saturation": (WINDING + "/>", ""),
    "a cable": ('<motor tendon="{0}" ctrlrange="-6 6"/>', SPATIAL),
    "a plugin": ('<plugin plugin="mujoco.pid" joint="{0}2" ctrlrange="-3 3"><config key="kp" value="9"/></plugin>', ""),
    "a rod": ('<motor cranksite="{0}" slidersite="top" cranklength="0.5" ctrlrange="-6 6"/>', ""),
    "nothing": ("", ""),
}
MUSCLE = '<muscle joint="{0}2" lengthrange="-1 1" force="60" forcelimited="true" forcerange="-20 20"/>'
NO_TORQUE = {
    "a motor that pulls alone": ('<motor joint="{0}2" ctrlrange="0 9"/>', ""),
    "a muscle": ('<muscle joint="{0}2" lengthrange="-1 1" force="10"/>', ""),
    "a muscle with a limit": (MUSCLE, ""),
    "a gear of 0": ('<motor joint="{0}2" ctrlrange="-9 9" gear="0"/>', ""),
}


def with_knees(motors: str, tendons: str = "") -> str:
    """Return the plain model with other motors at its knees, and a site in each shin."""
    model = re.sub(r'<motor joint="\w2"[^>]*/>', "", PLAIN)
    motors = "".join(motors.format(leg) for leg in LEGS)
    model = model.replace("</actuator>", f"{motors}</actuator>").replace(
        TRUNK, f'{TRUNK}<site name="top" pos="0.1 0 0.1"/>'
    )
    for leg in LEGS:
        model = model.replace(f'<joint name="{leg}2"', f'<site name="{leg}" pos="0.03 0 -0.1"/><joint name="{leg}2"')
    tendons = "".join(tendons.format(leg) for leg in LEGS)
    if "<plugin" in motors:
        model = model.replace("<default>", '<extension><plugin plugin="mujoco.pid"/></extension><default>', 1)
    return model.replace("</mujoco>", f"<tendon>{tendons}</tendon></mujoco>" if tendons else "</mujoco>")


def by_mujoco(xml: str, joint: str) -> float:
    """Return the smaller of the largest torques in both directions at `qpos0`, N·m."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    torques = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        mujoco.mj_resetData(model, data)
        data.ctrl[:] = 1e6 * rng.choice((-1.0, 1.0), model.nu)
        data.act[:] = 1e6 * rng.choice((-1.0, 1.0), model.na)
        for activation in np.flatnonzero(model.actuator_actadr >= 0):
            if model.actuator_actlimited[activation]:
                address = model.actuator_actadr[activation]
                data.act[address] = np.clip(data.act[address], *model.actuator_actrange[activation])
            elif model.actuator_ctrllimited[activation]:
                address = model.actuator_actadr[activation]
                data.act[address] = np.clip(data.act[address], *model.actuator_ctrlrange[activation])
        mujoco.mj_forward(model, data)
        torques.append(data.qfrc_actuator[model.joint(joint).dofadr[0]])
    return float(min(max(torques), -min(torques)))


@pytest.mark.parametrize("kind", KNEES)
def test_it_is_what_mujoco_s_actuators_give(kind: str, tmp_path: Path) -> None:
    motors, tendons, torque = KNEES[kind]
    model = with_knees(motors, tendons)
    if kind != "saturation":  # MuJoCo reaches the saturation current with the voltage
        assert by_mujoco(model, "A2") == pytest.approx(torque)
    assert robot_of_text(tmp_path, model).rated_torque == pytest.approx(torque)


@pytest.mark.parametrize("kind", UNKNOWN)
def test_where_it_is_unknown_it_is_asked_for_by_the_names_of_the_joints(kind: str, tmp_path: Path) -> None:
    model = with_knees(*UNKNOWN[kind])
    with pytest.raises(ModelError, match=r"torque of .*: give rated_torque, N·m") as caught:
        robot_of_text(tmp_path, model)
    assert all(f"{leg}2" in str(caught.value) for leg in LEGS)
    assert "\n" not in str(caught.value)
    assert robot_of_text(tmp_path, model, rated_torque=14.0).rated_torque == 14.0


@pytest.mark.parametrize("kind", NO_TORQUE)
def test_joints_that_get_no_torque_one_way_are_named_as_such(kind: str, tmp_path: Path) -> None:
    model = with_knees(*NO_TORQUE[kind])
    with pytest.raises(ModelError, match=r"torque by the model is 0, one way or both, of B2, A2, D2, C2: give"):
        robot_of_text(tmp_path, model)
    assert robot_of_text(tmp_path, model, rated_torque=14.0).rated_torque == 14.0


def test_a_motor_beyond_all_numbers_is_asked_for_without_a_warning(tmp_path: Path) -> None:
    model = with_knees('<motor joint="{0}2" gear="1e300" ctrlrange="-1e300 1e300"/>')
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(ModelError, match="does not say the largest torque of B2"):
            robot_of_text(tmp_path, model)


def test_actuators_of_a_disabled_group_give_nothing(tmp_path: Path) -> None:
    extra = "".join(f'<motor joint="{leg}2" group="3" ctrlrange="-50 50"/>' for leg in LEGS)
    model = PLAIN.replace("</actuator>", f"{extra}</actuator>")
    assert robot_of_text(tmp_path, model).rated_torque == 30.0  # rated torque of hips and thighs
    lean = model.replace('ctrlrange="-30.0 30.0"', 'ctrlrange="-20 20"').replace(
        "<default>", '<option actuatorgroupdisable="3"/><default>', 1
    )
    assert robot_of_text(tmp_path, lean).rated_torque == 20.0


@pytest.mark.parametrize("asked", [None, 10.0, 45.0])
def test_what_is_asked_for_is_what_the_motors_give(asked: float | None, tmp_path: Path) -> None:
    """The torque may exceed the limit of the model's joints.

    Without a value, the smallest limit of the joints applies.
    """
    path = tmp_path / "limited.xml"
    model = PLAIN.replace('armature="0.01"', 'armature="0.01" actuatorfrcrange="-18 20"')
    path.write_text(model, encoding="utf-8")
    robot = Robot.from_mjcf(path) if asked is None else Robot.from_mjcf(path, rated_torque=asked)
    wanted = 18.0 if asked is None else asked
    assert robot.rated_torque == wanted
    env = SimpleQuadVectorEnv(1, robot=robot.with_servo(1e4, 1.0), nthread=1, terminate_on_fall=False)
    env.reset(seed=0)
    largest = 0.0
    for step in range(20):
        target = robot.joint_upper if step % 4 < 2 else robot.joint_lower
        env.step(target[None].astype(np.float32))
        largest = max(largest, float(np.abs(env.simulation.snapshot(0).qfrc_actuator).max()))
    assert largest == pytest.approx(wanted)


def test_no_joint_limit_cuts_what_a_motor_of_another_peak_torque_gives(tmp_path: Path) -> None:
    robot = robot_of_text(tmp_path, PLAIN.replace('armature="0.01"', 'armature="0.01" actuatorfrcrange="-18 20"'))
    strong = Actuator(TorqueSpeed(stall_torque=60.0, peak_torque=50.0))
    model = compile_model(robot, SCENARIOS["flat"], strong)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qpos[7:] += 100.0
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qfrc_actuator[6:], -50.0)


def test_an_effort_of_zero_is_unknown(tmp_path: Path) -> None:
    model = re.sub(r'(_2_joint.*?effort=)"30"', r'\1"0"', urdf())
    assert model.count('effort="0"') == 4
    with pytest.raises(ModelError, match="torque of fl_2_joint, fr_2_joint, hl_2_joint, hr_2_joint: give rated_torque"):
        Robot.from_mjcf(written(tmp_path, model))


def test_rotors_and_bearings_of_motors_are_their_joints(tmp_path: Path) -> None:
    """Rotor inertia and damping are scaled by the square of the gear, and remain when a servo replaces the motor."""
    rotor = 'armature="0.001" damping="0.02 0.03 0.04" gear="3"'
    robot = robot_of_text(tmp_path, Made().xml().replace("<motor ", f"<motor {rotor} "))
    np.testing.assert_allclose(robot.model.dof_armature[6:], 0.01 + 9.0 * 0.001)
    np.testing.assert_allclose(robot.model.dof_damping[6:], 9.0 * 0.02)
    np.testing.assert_allclose(robot.model.dof_dampingpoly[6:], np.tile((9.0 * 0.03, 9.0 * 0.04), (12, 1)))
