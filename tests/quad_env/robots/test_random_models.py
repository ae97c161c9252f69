"""A robot of a model with any attributes moves as in MuJoCo's compilation, except for features that a line names."""

import os
from pathlib import Path

import mujoco
import numpy as np
import pytest

from quad_env import ModelError, Robot
from quad_env.robots.model_file import read
from quad_env.robots.model_remarks import omission_lines
from quad_env.robots.part_names import foot_geoms
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.quad_env.robots.random_models import RANGES, Drawn, draw

COUNT = int(os.environ.get("RANDOM_MODELS", "12"))
"""Number of models; 500 take several minutes."""
STATES = 3
FORCE = 1e6
"""N·m; a control signal beyond all limits."""


def neutral(drawn: Drawn) -> mujoco.MjModel:
    """Return MuJoCo's model without the features that the robot must not have, if a line names them."""
    model = mujoco.MjModel.from_xml_string(drawn.xml)
    if "gravcomp" in drawn.headings:
        model.body_gravcomp[:] = 0.0
    if "free joint" in drawn.headings:
        model.jnt_stiffness[0] = 0.0
        for field in ("damping", "armature", "frictionloss"):
            getattr(model, f"dof_{field}")[:6] = 0.0
    if "left out" in drawn.headings:
        for field in ("stiffness", "damping", "armature", "frictionloss"):
            getattr(model, f"tendon_{field}")[:] = 0.0
    if "settings" in drawn.headings:
        model.opt.gravity = (0.0, 0.0, -9.81)
        model.opt.wind = (0.0, 0.0, 0.0)
        model.opt.density = model.opt.viscosity = 0.0
    if "contact" in drawn.headings:
        model.geom_adhesion[:] = 0.0
    if "springyield" in drawn.headings:
        model.jnt_springyield[:] = 1e6
    return model


def largest_torques(drawn: Drawn) -> np.ndarray:
    """Return minimum and maximum torque of each joint by MuJoCo's own `qfrc_actuator`, (12, 2), N·m."""
    model = mujoco.MjModel.from_xml_string(drawn.xml)
    model.body_gravcomp[:] = 0.0  # `actuatorgravcomp` would count it as a motor torque
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    levers = np.zeros((model.nout, model.nv))
    mujoco.mju_sparse2dense(levers, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind)
    found = []
    for joint in drawn.joints:
        dof = model.joint(joint.name).dofadr[0]
        gains = np.repeat(np.sign(levers[:, dof]), model.actuator_ctrlnum)
        torques = []
        for sign in (-1.0, 1.0):
            data.ctrl[:] = sign * FORCE * gains
            mujoco.mj_forward(model, data)
            torques.append(data.qfrc_actuator[dof])
        found.append(torques)
    return np.array(found)


@pytest.mark.parametrize("seed", range(COUNT))
def test_a_model_of_random_attributes_moves_as_mujoco_has_it(seed: int, tmp_path: Path) -> None:
    drawn = draw(seed)
    path = tmp_path / "random.xml"
    path.write_text(drawn.xml, encoding="utf-8")
    largest = largest_torques(drawn)
    least = np.minimum(-largest[:, 0], largest[:, 1])
    unknown = (np.abs(largest).max(axis=1) > 1e3) | (least <= 0.0)
    given = {}
    if unknown.any():
        with pytest.raises(ModelError, match="give rated_torque") as caught:
            Robot.from_mjcf(path)
        names = [joint.name for joint, lacks in zip(drawn.joints, unknown, strict=True) if lacks]
        assert f"torque of {', '.join(names)}: give" in str(caught.value)
        given = {"rated_torque": 55.0}
    robot = Robot.from_mjcf(path, **given)
    assert {heading for heading, _ in omission_lines(read(path))} == drawn.headings
    assert robot.rated_torque == pytest.approx(given.get("rated_torque", least.min()), rel=1e-9)
    ours, theirs = robot.model, neutral(drawn)
    np.testing.assert_allclose(robot.joint_lower, np.tile([low for low, _ in RANGES], 4), atol=1e-9)
    np.testing.assert_allclose(robot.joint_upper, np.tile([high for _, high in RANGES], 4), atol=1e-9)
    _same_motion(drawn, ours, theirs)
    _same_joints(drawn, ours, theirs)
    _full_torque(robot)
    _our_contacts(robot, theirs)


def _same_motion(drawn: Drawn, ours: mujoco.MjModel, theirs: mujoco.MjModel) -> None:
    """Check that inertia, bias and passive forces agree at random states, with the other joints at rest."""
    rng = np.random.default_rng(1)
    signs = np.array([1.0] * 6 + [joint.sign for joint in drawn.joints])
    rows = [[*range(6), *(model.joint(joint.name).dofadr[0] for joint in drawn.joints)] for model in (ours, theirs)]
    for _ in range(STATES):
        root = np.concatenate((rng.normal(size=3), _unit(rng.normal(size=4))))
        angles = [rng.uniform(*RANGES[number % 3]) for number in range(12)]
        speed = rng.normal(size=18)
        results = []
        for model, own in ((ours, True), (theirs, False)):
            data, inertia = mujoco.MjData(model), np.empty((model.nv, model.nv))
            data.qpos[:7] = root
            for joint, angle in zip(drawn.joints, angles, strict=True):
                place = model.joint(joint.name).qposadr[0]
                data.qpos[place] = angle if own else joint.ref + joint.sign * (angle - joint.zero)
            place = rows[0] if own else rows[1]
            data.qvel[place] = speed if own else signs * speed
            mujoco.mj_forward(model, data)
            mujoco.mj_fullM(model, data, inertia)
            turn = np.ones(18) if own else signs
            sub = inertia[np.ix_(place, place)]
            results.append((turn[:, None] * sub * turn, turn * data.qfrc_bias[place], turn * data.qfrc_passive[place]))
        for one, other in zip(*results, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-7, atol=1e-8)


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


def _same_joints(drawn: Drawn, ours: mujoco.MjModel, theirs: mujoco.MjModel) -> None:
    """Check that dry friction and solver parameters of joints agree."""
    pairs = [(ours.joint(joint.name), theirs.joint(joint.name)) for joint in drawn.joints]
    for one, other in pairs:
        for field in ("jnt_margin", "jnt_solref", "jnt_solimp"):
            np.testing.assert_allclose(getattr(ours, field)[one.id], getattr(theirs, field)[other.id], err_msg=field)
        for field in ("dof_frictionloss", "dof_solref", "dof_solimp"):
            values = [getattr(model, field)[each.dofadr[0]] for model, each in ((ours, one), (theirs, other))]
            np.testing.assert_allclose(*values, err_msg=field)


def _full_torque(robot: Robot) -> None:
    """Check that each servo gives the robot's rated torque in both directions."""
    model = robot.model
    data = mujoco.MjData(model)
    for sign in (-1.0, 1.0):
        mujoco.mj_resetDataKeyframe(model, data, 0)
        data.qpos[7:] -= sign * FORCE  # far from its target
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.qfrc_actuator[6:], sign * robot.rated_torque)


def _our_contacts(robot: Robot, theirs: mujoco.MjModel) -> None:
    """Check that contacts have SimpleQuad's parameters, and the model's friction and bits."""
    model = robot.model
    bench = SIMPLE_QUAD.model
    foot = foot_geoms(bench, "fl")[0]
    geoms = np.flatnonzero(model.geom_bodyid != 0)
    for field in ("condim", "priority", "margin", "gap", "solref", "solimp", "solmix", "adhesion", "surfacevel"):
        values = getattr(model, f"geom_{field}")
        np.testing.assert_array_equal(
            values[geoms], np.broadcast_to(values[0] * 0 + getattr(bench, f"geom_{field}")[foot], values[geoms].shape)
        )
    np.testing.assert_allclose(np.unique(model.geom_friction[geoms], axis=0), np.unique(theirs.geom_friction, axis=0))
