"""A user's model has the meaning of MuJoCo's compiler for any units, masses, scene, feet and trunk."""

import copy
import os
import re
import sys
import time
import warnings
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from quad_env import Robot
from quad_env.cli import limited_process
from quad_env.describe import description_lines
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.physics.model import compile_model
from quad_env.robots import model_file
from quad_env.robots.model_file import read
from quad_env.robots.part_names import foot_geoms
from quad_env.robots.plausibility import find_warnings
from quad_env.robots.registry import MODEL_PACKAGE, ROBOTS
from quad_env.robots.shapes import welded_bodies
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.robots.structure import ModelError
from quad_env.scenarios.registry import SCENARIOS
from tests.quad_env.robots.made import Made
from tests.quad_env.robots.test_parameter_inference import NAMED, changed

resource: Any = pytest.importorskip("resource") if os.name != "nt" else None
PLAIN = Made().xml()
TRUNK = '<geom type="box" size="0.22 0.1 0.05"/>'
UNSEEN = 'contype="0" conaffinity="0"'
SHIN = '<geom type="capsule" size="0.012" fromto="0 0 -0.01 0 0 -0.19" mass="0.1"/>'
BALL = Made().foot


def robot_of_text(folder: Path, model: str, file: str = "made.xml", **figures: Any) -> Robot:
    path = folder / file
    path.write_text(model, encoding="utf-8")
    return Robot.from_mjcf(path, **figures)


def in_degrees(model: str) -> str:
    """Return the model with angles in degrees, MuJoCo's default unit."""

    def turned(found: re.Match[str]) -> str:
        return f'{found[1]}="{" ".join(repr(float(np.rad2deg(float(each)))) for each in found[2].split())}"'

    return re.sub(r'\b(range|ref|springref)="([^"]*)"', turned, model).replace('angle="radian"', 'angle="degree"')


def standing(robot: Robot) -> tuple[SimpleQuadVectorEnv, dict[str, Any]]:
    """Return an environment with one robot that stood for a second, and its last info."""
    env = SimpleQuadVectorEnv(1, robot=robot, nthread=1, readings=True)
    env.reset(seed=0, options={"command": np.zeros((1, 3))})
    for _ in range(100):
        _, _, terminated, _, info = env.step(robot.home_pose[None].astype(np.float32))
        assert not terminated.any()
    return env, info


def floats(*values: float) -> st.SearchStrategy[float]:
    return st.sampled_from(values)


COMPILERS = st.fixed_dictionaries(
    {},
    optional={
        "settotalmass": floats(4.0, 30.0),
        "boundmass": floats(0.6),
        "boundinertia": floats(0.01),
        "balanceinertia": st.just("true"),
        "inertiafromgeom": st.sampled_from(("true", "false", "auto")),
        "inertiagrouprange": st.sampled_from(("0 0", "0 2")),
        "alignfree": st.sampled_from(("true", "false")),
        "fusestatic": st.just("true"),
        "discardvisual": st.just("true"),
        "fitaabb": st.just("true"),
        "eulerseq": st.sampled_from(("xyz", "zyx", "XYZ")),
        "autolimits": st.just("true"),
    },
)


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    compiler=COMPILERS,
    degrees=st.booleans(),
    signs=st.tuples(*3 * [st.sampled_from((-1, 1))]),
    zeros=st.sampled_from(((0.0, 0.0, 0.0), (0.2, 0.7, -1.4))),
)
def test_every_option_of_the_compiler_is_kept(
    tmp_path: Path, compiler: dict[str, Any], degrees: bool, signs: tuple[int, int, int], zeros: tuple[float, ...]
) -> None:
    # MuJoCo refuses this combination.
    assume(compiler.get("inertiafromgeom") != "true" or "discardvisual" not in compiler)
    made = Made(signs=signs, zeros=zeros, foot=SHIN + BALL, extra=TOWER)
    model = made.xml().replace(
        ' armature="0.01"', ' armature="0.01" stiffness="3" springref="0.1" actuatorfrcrange="-20 25"'
    )
    model = in_degrees(model) if degrees else model
    kept = "".join(f' {name}="{value}"' for name, value in compiler.items() if name != "autolimits")
    model = model.replace(' autolimits="true"', f' autolimits="true"{kept}')
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # settotalmass is deprecated
        theirs = mujoco.MjModel.from_xml_string(model)
    robot = robot_of_text(tmp_path, model)
    user_model = read(robot.mjcf)
    ours, own, found = robot.model, user_model.model, user_model.structure
    assert ours.body_mass.sum() == pytest.approx(theirs.body_mass.sum(), rel=1e-9)
    names = robot.joint_names
    rows = [[model.joint(name).dofadr[0] for name in names] for model in (ours, theirs)]
    for angles in np.random.default_rng(0).uniform(-0.3, 0.3, (3, 12)):
        masses, passive = [], []
        for model, moved, place in (
            (ours, angles, rows[0]),
            (theirs, found.signs * (angles - found.joint_offsets), rows[1]),
        ):
            data, inertia = mujoco.MjData(model), np.empty((model.nv, model.nv))
            data.qpos[7:] = moved if model is ours else moved + own.qpos0[7:]
            mujoco.mj_forward(model, data)
            mujoco.mj_fullM(model, data, inertia)
            masses.append(inertia[np.ix_(place, place)])
            passive.append(data.qfrc_passive[place])
        np.testing.assert_allclose(masses[0], np.outer(found.signs, found.signs) * masses[1], atol=1e-9)
        np.testing.assert_allclose(passive[0], found.signs * passive[1], atol=1e-9)
    for name, sign, zero in zip(names, found.signs, found.joint_offsets, strict=True):
        one, other = ours.joint(name), theirs.joint(name)
        np.testing.assert_allclose(one.range, np.sort(zero + sign * (other.range - other.qpos0)), atol=1e-9)
        forces = ours.jnt_actfrcrange[one.id], np.sort(sign * theirs.jnt_actfrcrange[other.id])
        np.testing.assert_allclose(*forces, atol=1e-9)
    assert robot.rated_torque == pytest.approx(20.0)


TOWER = (
    '<body name="tower" pos="0 0 0.05" euler="0 0 0"><geom type="cylinder" size="0.02 0.03" mass="0.3"/>'
    '<body pos="0 0 0.1"><geom type="sphere" size="0.03" mass="0.2" group="3" contype="0" conaffinity="0"/></body>'
    "</body>"
)


SCENE = """<body name="crate" pos="3 0 1"><geom type="box" size="1 1 1" mass="600"/></body>
<body name="ball" pos="3 3 1"><freejoint/><geom size="0.1" mass="50"/></body>
<body name="door" pos="-3 0 1"><joint name="hinge" axis="0 0 1"/><geom size="1" mass="9"/></body>
<body name="target" mocap="true" pos="-3 3 1"><geom size="0.1" contype="0"/></body>"""


def test_what_is_not_the_robot_is_left_out_and_named(tmp_path: Path) -> None:
    plain = robot_of_text(tmp_path, PLAIN, "plain.xml")
    robot = robot_of_text(tmp_path, Made(obstacle=SCENE).xml())
    assert (robot.mass, robot.servo) == (plain.mass, plain.servo)
    assert robot.model.nbody == plain.model.nbody
    (said,) = (line for line in description_lines(robot) if line.startswith("left out"))
    assert all(f"body {thing}" in said for thing in ("crate", "ball", "door", "target"))


def test_two_robots_in_a_file_are_refused_in_a_line(tmp_path: Path) -> None:
    geom = '<geom size="0.1"/>'
    arm = f'<body pos="9 0 1"><freejoint/>{geom}<body><joint axis="1 0 0"/>{geom}</body></body>'
    assert robot_of_text(tmp_path, Made(obstacle=arm).xml()).num_joints == 12
    again = Made().xml().split("<worldbody>")[1].split("</worldbody>")[0]
    again = re.sub(r'name="(\w+)"', r'name="other_\1"', again).replace('<geom type="plane" size="5 5 1"/>', "")
    with pytest.raises(ValueError, match=r"2 bodies have a free joint.*'other_torso', 'torso'"):
        robot_of_text(tmp_path, Made(obstacle=again).xml())


FEET = {  # shape, centre below the knee, radius, depth of the sole below the knee with a straight leg
    "box": ('<geom type="box" size="0.03 0.02 0.015" pos="{x} 0 -0.225" mass="0.05"/>', 0.225, 0.015, 0.24),
    "lying cylinder": (
        '<geom type="cylinder" size="0.02 0.025" euler="1.5707963267948966 0 0" pos="{x} 0 {z}" mass="0.05"/>',
        0.22,
        0.02,
        0.24,
    ),
    "ellipsoid": ('<geom type="ellipsoid" size="0.03 0.03 0.02" pos="{x} 0 {z}" mass="0.05"/>', 0.22, 0.02, 0.24),
    "mesh": ('<geom type="mesh" mesh="foot" pos="{x} 0 {z}" mass="0.05"/>', 0.22, 0.02, 0.24),
    "own body": ('<body pos="{x} 0 {z}"><geom type="sphere" size="0.02" mass="0.05"/></body>', 0.22, 0.02, 0.24),
    "two balls": (
        '<geom size="0.02" pos="{x} 0.02 {z}" mass="0.03"/><geom size="0.02" pos="{x} -0.02 {z}" mass="0.03"/>',
        0.22,
        0.02,
        0.24,
    ),
    "capsule": ('<geom type="capsule" size="0.02" fromto="0 -0.02 {z} 0 0.02 {z}" mass="0.05"/>', 0.22, 0.02, 0.24),
}
MESH = (
    '<asset><mesh name="foot" vertex="-0.02 -0.02 -0.02 0.02 -0.02 -0.02 -0.02 0.02 -0.02 0.02 0.02 -0.02 '
    '-0.02 -0.02 0.02 0.02 -0.02 0.02 -0.02 0.02 0.02 0.02 0.02 0.02"/></asset>'
)


def feet_of(shape: str) -> str:
    return Made(foot=SHIN + FEET[shape][0]).xml().replace("<default>", MESH + "<default>", 1)


@pytest.mark.parametrize("shape", FEET)
def test_the_lowest_geom_is_the_foot_whatever_its_shape(shape: str, tmp_path: Path) -> None:
    """The test compares size, contacts, carried weight, and height for any orientation of the leg."""
    _, centre, radius, sole = FEET[shape]
    robot = robot_of_text(tmp_path, feet_of(shape))
    assert robot.calf_length == pytest.approx(centre, abs=1e-6)
    assert robot.foot_radius == pytest.approx(radius, abs=1e-6)
    data = mujoco.MjData(robot.model)
    data.qpos[2], data.qpos[3] = 1.0, 1.0
    mujoco.mj_forward(robot.model, data)
    straight = robot.foot_radius if not robot.foot_points.size else -robot.foot_points[..., 2].min()
    assert data.site("fl_foot").xpos[2] - straight == pytest.approx(1.0 - robot.thigh_length - sole, abs=1e-4)
    env, info = standing(robot)
    assert info["foot_contact"].all()
    assert not info["leg_contact"].any()
    assert env.simulation.state((np.zeros(1),) * 3).height == pytest.approx(robot.home_height, abs=4e-3)
    assert np.abs(info["foot_height"]).max() < 3e-3
    data = env.simulation.snapshot(0)
    carried = sum(float(data.sensor(f"{leg}_foot_touch").data[0]) for leg in robot.leg_names)
    assert carried == pytest.approx(robot.mass * 9.81, rel=0.02)
    for turn in ((0.0, 0.0, 0.0), (0.3, -0.4, 0.0)):
        env.reset(seed=3)
        target = robot.home_pose + np.random.default_rng(0).uniform(-0.2, 0.2, 12) + np.resize(turn, 12)
        for _ in range(3):
            *_, info = env.step(target[None].astype(np.float32))
        data, model = env.simulation.snapshot(0), env.simulation.model
        ground = model.geom("ground").id
        for place, leg in enumerate(robot.leg_names):
            geoms = foot_geoms(model, leg)
            lowest = min(mujoco.mj_geomDistance(model, data, geom, ground, 1.0, None) for geom in geoms)
            assert info["foot_height"][0, place] == pytest.approx(lowest, abs=2e-3)


HEADS = Made(extra=f'{BALL.format(x=0.3, z=0.1)}<body name="head">{BALL.format(x=0.3, z=-0.1)}</body>').xml()


@pytest.mark.parametrize("name", ["made", *(each for each in NAMED if each.values[0] in ("go1", "pegasus"))])
def test_each_colliding_geom_of_each_robot_s_trunk_on_the_ground_is_a_fall(name: str, tmp_path: Path) -> None:
    """Each geom is the only one of the robot that can touch the ground: the fall comes within three control steps."""
    robot = robot_of_text(tmp_path, HEADS) if name == "made" else ROBOTS[name]
    env = SimpleQuadVectorEnv(1, robot=robot, nthread=1)
    model, batch = env.simulation.model, env.simulation.batch
    stepped = copy.copy(batch.model)
    solid = (model.geom_contype | model.geom_conaffinity) != 0
    trunk = np.isin(model.geom_bodyid, welded_bodies(model, model.body("base_link").id)) & solid
    assert trunk.any()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_kinematics(model, data)
    for geom in np.flatnonzero(trunk):
        alone = (np.arange(model.ngeom) == geom) | (model.geom_bodyid == 0)
        stepped.geom_contype[:] = np.where(alone, model.geom_contype, 0)
        stepped.geom_conaffinity[:] = np.where(alone, model.geom_conaffinity, 0)
        batch.set_models(stepped)
        env.reset(seed=0, options={"command": np.zeros((1, 3))})
        start = data.qpos.copy()
        start[2] -= mujoco.mj_geomDistance(model, data, int(geom), model.geom("ground").id, 10.0, None) + 0.005
        env.simulation.qpos[0], env.simulation.qvel[0] = start, 0.0
        for _ in range(3):
            *_, terminated, _, info = env.step(robot.home_pose[None].astype(np.float32))
            if terminated[0]:
                break
        assert info["fall"][0] == 1, model.geom(int(geom)).name  # trunk_contact


def test_each_geom_of_a_leg_is_seen_and_no_foot_is_a_shin(tmp_path: Path) -> None:
    pads = '<geom type="box" size="0.02 0.02 0.02" mass="0.1"/>' + SHIN + BALL
    made = Made(foot=pads).xml()
    made = made.replace(
        '<joint name="A1"', '<geom type="sphere" size="0.03"/><geom type="sphere" size="0.02"/><joint name="A1"'
    )
    model = compile_model(robot_of_text(tmp_path, made), SCENARIOS["flat"])
    kinds, data = (model.geom_contype.copy(), model.geom_conaffinity.copy()), mujoco.MjData(model)
    watching = [n for n in range(model.nsensor) if "_ground" in model.sensor(n).name]
    for link in ("thigh", "calf"):
        on_link = np.flatnonzero(model.geom_bodyid == model.body(f"fl_{link}_link").id)
        geoms = [int(geom) for geom in on_link if geom not in foot_geoms(model, "fl")]
        assert len(geoms) == 2
        for geom in geoms:
            alone = (model.geom_bodyid == 0) | (np.arange(model.ngeom) == geom)
            model.geom_contype[:], model.geom_conaffinity[:] = (np.where(alone, kind, 0) for kind in kinds)
            mujoco.mj_resetDataKeyframe(model, data, 0)
            mujoco.mj_kinematics(model, data)
            data.qpos[2] -= data.geom_xpos[geom, 2]
            mujoco.mj_forward(model, data)
            touched = {model.sensor(n).name for n in watching if data.sensor(n).data[0] > 0}
            assert touched
            assert all(name.startswith(f"fl_{link}_ground") for name in touched)


def test_a_trunk_keeps_its_own_centre(tmp_path: Path) -> None:
    box = '<geom type="box" size="0.2 0.08 0.05" pos="0.02 0 0.06"/>'
    solid = robot_of_text(tmp_path, PLAIN.replace(TRUNK, box), file="solid.xml")
    shown = robot_of_text(tmp_path, PLAIN.replace(TRUNK, box.replace("/>", f" {UNSEEN}/>")), file="shown.xml")
    for robot in (solid, shown):
        np.testing.assert_allclose(robot.trunk_size, (0.4, 0.16, 0.1), atol=1e-12)
        np.testing.assert_allclose(robot.trunk_centre, (0.02, 0.0, 0.06), atol=1e-12)
        model = compile_model(robot, SCENARIOS["payload"])
        payload = model.body("payload").id
        assert model.body_pos[payload, 2] - model.geom("payload").size[2] == pytest.approx(0.11)
        standing(robot)
    trunk = shown.model.geom("trunk")
    np.testing.assert_allclose((*trunk.pos, *trunk.size), (0.02, 0.0, 0.06, 0.2, 0.08, 0.05), atol=1e-12)
    assert any("does not collide in the model" in line for line in description_lines(shown))
    assert not any("does not collide in the model" in line for line in description_lines(solid))


@pytest.mark.parametrize("rise", [0.05, -0.08])
def test_hips_may_be_above_or_below_the_trunk_s_origin(rise: float, tmp_path: Path) -> None:
    plain = robot_of_text(tmp_path, PLAIN).home_height
    moved = re.sub(r'(<body pos="-?0.2 -?0.1) 0.0"', rf'\1 {rise}"', PLAIN)
    robot = robot_of_text(tmp_path, moved)
    assert robot.home_height == pytest.approx(plain - rise)
    env, _ = standing(robot)
    assert env.simulation.state((np.zeros(1),) * 3).height == pytest.approx(robot.home_height, abs=4e-3)


def test_our_ground_collides_with_whatever_bits_a_robot_has(tmp_path: Path) -> None:
    for bits in ((2, 2), (4, 0), (0, 8), (1 << 30, 1 << 30)):
        layer = PLAIN.replace(
            '<geom friction="0.9"/>', f'<geom friction="0.9" contype="{bits[0]}" conaffinity="{bits[1]}"/>'
        )
        _, info = standing(robot_of_text(tmp_path, layer))
        assert info["foot_contact"].all()


def test_our_ground_collides_with_what_a_pair_names(tmp_path: Path) -> None:
    model = PLAIN.replace('<geom friction="0.9"/>', f'<geom friction="0.9" {UNSEEN}/>')
    model = model.replace('<geom type="plane"', '<geom name="floor" type="plane"')
    names = iter("ABCD")
    model = re.sub(r'<geom type="sphere"', lambda _: f'<geom name="{next(names)}" type="sphere"', model)
    pairs = "".join(f'<pair geom1="floor" geom2="{name}"/>' for name in "ABCD") + '<pair geom1="A" geom2="B"/>'
    robot = robot_of_text(tmp_path, model.replace("<actuator>", f"<contact>{pairs}</contact><actuator>"))
    _, info = standing(robot)
    assert info["foot_contact"].all()
    assert robot.model.npair == 1  # the pair of its own feet


def test_no_two_geoms_of_a_robot_collide_that_did_not_before(tmp_path: Path) -> None:
    model = changed('<geom type="box" size="0.22 0.1 0.05"/>', TRUNK.replace("/>", ' contype="1" conaffinity="0"/>'))
    compiled = robot_of_text(
        tmp_path, model.replace('<geom friction="0.9"/>', '<geom friction="0.9" conaffinity="2"/>')
    ).model
    own = compiled.geom_bodyid > 0
    meet = compiled.geom_contype[:, None] & compiled.geom_conaffinity[None]
    assert not (meet | meet.T)[np.ix_(own, own)].any()
    assert (meet | meet.T)[compiled.geom("ground").id, own].all()


@pytest.mark.parametrize("offset", ["", ' pos="0.1 0.02 0.3"', ' pos="0 0 0.3" euler="0 0 0.2"'])
def test_welded_bodies_above_the_trunk_are_followed(offset: str, tmp_path: Path) -> None:
    plain = robot_of_text(tmp_path, PLAIN, name="made")
    home, limits, mass = plain.home_height, plain.joint_lower.copy(), plain.mass
    dummy = '<body name="base" pos="0 0 0.5"><freejoint/><geom size="0.01" mass="0.001" contype="0" conaffinity="0"/>'
    model = changed('<body name="torso" pos="0 0 0.5"><freejoint/>', f'{dummy}<body name="torso"{offset}>')
    robot = robot_of_text(tmp_path, model.replace("</worldbody>", "</body></worldbody>"))
    assert robot.home_height == pytest.approx(home)
    assert robot.mass == pytest.approx(mass + 0.001)
    np.testing.assert_allclose(robot.joint_lower, limits, atol=1e-12)
    np.testing.assert_allclose(robot.hip_positions, plain.hip_positions, atol=1e-9)
    np.testing.assert_allclose(robot.model.body("base_link").pos[:2], 0.0, atol=1e-12)
    standing(robot)


def test_settings_of_the_file_that_are_ours_are_taken_without_a_word(tmp_path: Path) -> None:
    settings = '<visual><map zfar="100"/></visual><size memory="20M"/><option gravity="0 0 -1"/>'
    standing(robot_of_text(tmp_path, PLAIN.replace("<default>", f"{settings}<default>", 1)))  # a warning is an error


def test_unlikely_figures_are_named_and_not_refused(tmp_path: Path) -> None:
    assert list(find_warnings(robot_of_text(tmp_path, PLAIN))) == []
    said = {
        "a placeholder": Made(torque=1000.0).xml(),
        "masses in another unit": Made(torque=0.5).xml(),
        "a model in millimetres": re.sub(
            r'(pos|size)="([^"]*)"',
            lambda m: f'{m[1]}="{" ".join(str(1e3 * float(v)) for v in m[2].split())}"',
            PLAIN,
        ),
    }
    for words, model in said.items():
        lines = list(find_warnings(robot_of_text(tmp_path, model)))
        assert sum(words in line for line in lines) == 1, lines


def test_a_keyframe_is_read_with_the_signs_and_zeros_of_the_joints(tmp_path: Path) -> None:
    stand = np.array([0.0, 0.8, -1.5] * 4)
    for made in (Made(), Made(signs=(-1, -1, 1)), Made(signs=(-1, 1, -1), zeros=(0.1, 0.5, -0.9))):
        own = np.tile(made.signs, 4) * (stand - np.tile(made.zeros, 4))
        key = " ".join(map(str, (0.0, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0, *own)))
        model = made.xml().replace("</mujoco>", f'<keyframe><key qpos="{key}"/></keyframe></mujoco>')
        robot = robot_of_text(tmp_path, model)
        height = 0.2 * np.cos(0.8) + 0.22 * np.cos(0.7)
        assert robot.home_hip_height == pytest.approx(height)


def test_a_specification_is_of_its_robot_alone(tmp_path: Path) -> None:
    """The specification is built once and copied for every model; a changed file is read again."""
    robot = robot_of_text(tmp_path, PLAIN)
    stairs = compile_model(robot, SCENARIOS["stairs"], timestep=0.005)
    flat = compile_model(robot, SCENARIOS["flat"])
    assert stairs.ngeom > flat.ngeom == robot.model.ngeom
    assert (stairs.opt.timestep, flat.opt.timestep) == (0.005, 0.002)
    softer = compile_model(robot.with_servo(20.0, 0.5), SCENARIOS["flat"])
    np.testing.assert_array_equal(softer.actuator_gainprm[:, 0], 20.0)
    before = robot.mjcf.stat().st_mtime_ns
    robot_of_text(tmp_path, PLAIN.replace('friction="0.9"', 'friction="0.4"'))
    os.utime(robot.mjcf, ns=(before, before + 1_000_000))
    assert (compile_model(robot, SCENARIOS["flat"]).geom_friction != flat.geom_friction).any()


def asset(text: str) -> str:
    return PLAIN.replace("<worldbody>", f"<asset>{text}</asset><worldbody>", 1)


HOSTILE = {
    "itself.xml": (asset('<model name="m" file="itself.xml"/>'), "MuJoCo crashes as it reads it: "),
    "hfield.xml": (asset('<hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/>'), "memory"),
    "replicate.xml": (
        PLAIN.replace("<worldbody>", '<worldbody><replicate count="100000000"><geom size=".1"/></replicate>', 1),
        "of processor time|of memory",
    ),
    "keys.xml": (PLAIN.replace("<worldbody>", '<size nkey="100000000"/><worldbody>', 1), "processor time|memory"),
    "numbers.xml": (PLAIN.replace("<worldbody>", '<size nuserdata="1000000000"/><worldbody>', 1), "memory"),
    "deep.xml": (f"<mujoco><worldbody>{'<body>' * 100_000}{'</body>' * 100_000}</worldbody></mujoco>", "too deep"),
    "deep.urdf": ("<robot>" * 100_000 + "</robot>" * 100_000, "cannot read it|no URDF"),
    "laughs.urdf": (
        '<!DOCTYPE l [<!ENTITY a0 "aaaaaaaaaa">'
        + "".join(f'<!ENTITY a{n} "{f"&a{n - 1};" * 10}">' for n in range(1, 10))
        + ']><robot name="&a9;"/>',
        "no URDF",
    ),
    "large.xml": (asset('<mesh name="m" file="large.stl"/>'), "large.stl that it names cannot be read: it is larger"),
    "pipe.xml": (asset('<mesh name="m" file="pipe.stl"/>'), "pipe.stl that it names cannot be read: it is no regular"),
    "large.urdf": (
        '<robot name="r"><link name="a"><visual><geometry><mesh filename="large.stl"/></geometry></visual></link>'
        "</robot>",
        "large.stl that it names cannot be read: it is larger",
    ),
}
"""File -> its text, and the words of the error."""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux limits memory")
@pytest.mark.parametrize("name", HOSTILE)
def test_a_model_that_crashes_or_fills_or_never_ends_is_one_line(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("QUAD_ENV_READ_TIME", "2")
    with (tmp_path / "large.stl").open("wb") as sparse:
        sparse.truncate(3 * 2**30)
    os.mkfifo(tmp_path / "pipe.stl")
    text, words = HOSTILE[name]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = time.process_time()
    with pytest.raises(ModelError, match=words) as error:
        robot_of_text(tmp_path, text, name)
    assert str(error.value).startswith(f"{tmp_path / name}: ")
    assert "\n" not in str(error.value)
    assert time.process_time() - began < 5
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100 * 1024  # KiB


def test_a_model_is_read_apart_once_and_no_installed_one_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def noted(function: Any, file: Path, **options: Any) -> None:
        asked.append(file)

    monkeypatch.setattr(limited_process, "read_limited", noted)
    robot_of_text(tmp_path, PLAIN)
    assert set(asked) == {tmp_path / "made.xml"}
    asked.clear()
    model_file.read(SIMPLE_QUAD.mjcf)
    if find_spec(MODEL_PACKAGE) is not None:
        model_file.read(ROBOTS["go1"].mjcf)
    assert not asked


@pytest.mark.parametrize(("parts", "kind"), [("<keyframe>{}</keyframe>", "key"), ("<sensor>{}</sensor>", "clock")])
def test_thousands_of_parts_that_are_left_out_are_refused_at_once(parts: str, kind: str, tmp_path: Path) -> None:
    model = PLAIN.replace("</mujoco>", parts.format(f"<{kind}/>" * 5000) + "</mujoco>")
    with pytest.raises(ModelError, match=r"it has 500\d (keys|sensors): at most 2000 are read"):
        robot_of_text(tmp_path, model)


@pytest.mark.parametrize("what", ["damping", "armature", "friction loss", "stiffness"])
def test_what_is_negative_in_a_joint_is_named(what: str, tmp_path: Path) -> None:
    others = "" if what == "armature" else 'armature="0.01" '
    model = PLAIN.replace('armature="0.01"', f'{others}{what.replace(" ", "")}="-0.001"')
    (line,) = (each for each in find_warnings(robot_of_text(tmp_path, model)) if "negative" in each)
    assert line.endswith(f"11 more have a negative {what}: it must be at least 0")


@pytest.mark.parametrize(
    ("joint", "motor", "named"),
    [
        ('margin="inf"', "", "margin of joint"),
        ("", 'armature="inf"', "armature of"),
        ("", 'damping="nan"', "damping of"),
    ],
)
def test_what_is_not_finite_of_joints_and_motors_is_named(joint: str, motor: str, named: str, tmp_path: Path) -> None:
    model = PLAIN.replace('armature="0.01"', f'armature="0.01" {joint}').replace("<motor ", f"<motor {motor} ")
    with pytest.raises(ModelError, match=f"{named}.* is not finite"):
        robot_of_text(tmp_path, model)


def test_a_torque_beyond_all_numbers_makes_a_short_line(tmp_path: Path) -> None:
    model = PLAIN.replace('ctrlrange="-30.0 30.0"', 'ctrlrange="-1e300 1e300"')
    (line,) = find_warnings(robot_of_text(tmp_path, model))
    assert "1000000 times what standing takes or more" in line
