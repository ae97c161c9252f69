"""A URDF of a converter gives the robot of an MJCF with equal numbers."""

from pathlib import Path

import numpy as np
import pytest

import policies
from quad_env import ModelError, Robot
from quad_env.doctor.check import DoctorSubject
from quad_env.doctor.stance_check import stands
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.registry import get_robot
from tests.quad_env.robots.made import PLACES, Made

LEGS = "fl", "fr", "hl", "hr"
JOINTS = ("1 0 0", -0.8, 0.8), ("0 1 0", -1.6, 1.6), ("0 1 0", -2.5, -0.3)


def joint(name: str, parent: str, child: str, at: str, more: str = "", kind: str = "fixed") -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{at}" rpy="0 0 0"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{more}</joint>'


def link(name: str, mass: float, moment: float, shapes: str) -> str:
    moments = f'<inertia ixx="{moment}" ixy="0" ixz="0" iyy="{moment}" iyz="0" izz="{moment}"/>'
    return f'<link name="{name}"><inertial><mass value="{mass}"/>{moments}</inertial>{shapes}</link>'


def shape(geometry: str, at: str = "0 0 0", kind: str = "collision") -> str:
    return f'<{kind}><origin xyz="{at}"/><geometry>{geometry}</geometry></{kind}>'


BALL = '<sphere radius="0.025"/>'


def urdf(root: str = "", calf: str = shape(BALL, "0 0 -0.22"), thigh: str = "", foot: str = "") -> str:
    """Return the quadruped of `Made` as URDF; `foot` is in its own link on a fixed joint."""
    trunk = link("trunk", 6.0, 0.1, shape('<box size="0.44 0.2 0.1"/>'))
    parts, links = [root, trunk], list(zip(JOINTS, ("", thigh, calf), strict=True))
    for leg in LEGS:
        ahead, left = PLACES[leg]
        places = f"{0.2 * ahead} {0.1 * left} 0", f"0 {0.08 * left} 0", "0 0 -0.2"
        above = "trunk"
        for number, ((axis, low, high), shapes) in enumerate(links):
            more = f'<axis xyz="{axis}"/><limit lower="{low}" upper="{high}" effort="30" velocity="20"/>'
            name = f"{leg}_{number}"
            hinge = joint(f"{name}_joint", above, name, places[number], more, "revolute")
            parts += [link(name, 0.4, 0.002, shapes), hinge]
            above = name
        if foot:
            fixed = joint(f"{leg}_foot_joint", above, f"{leg}_foot", "0 0 -0.22")
            # SolidWorks exports a link without mass with these values.
            parts += [link(f"{leg}_foot", 4e-15, 2e-27, foot), fixed]
    return f'<?xml version="1.0"?><robot name="made">{"".join(parts)}</robot>'


LONG = shape('<cylinder radius="0.02" length="0.245"/>', "0 0 -0.1225")
WRITTEN = {
    "fixed feet": urdf(calf="", foot=shape(BALL)),
    "dummy root": urdf(root='<link name="base_link"/>' + joint("base_joint", "base_link", "trunk", "0 0 0.1")),
    "cylinders": urdf(calf=LONG, thigh=shape('<cylinder radius="0.02" length="0.16"/>', "0 0 -0.1")),
}


def written(folder: Path, model: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "made.urdf"
    path.write_text(model, encoding="utf-8")
    return path


@pytest.mark.parametrize("kind", WRITTEN)
def test_it_is_read_as_an_mjcf_is_and_stands(kind: str, tmp_path: Path) -> None:
    robot, made = get_robot(str(written(tmp_path, WRITTEN[kind]))), Robot.from_mjcf(Made().write(tmp_path))
    assert robot.joint_names == tuple(f"{leg}_{number}_joint" for leg in LEGS for number in range(3))
    for figure in ("mass", "hip_offset", "thigh_length", "trunk_size", "rated_torque", "joint_lower", "joint_upper"):
        np.testing.assert_allclose(getattr(robot, figure), getattr(made, figure), atol=1e-9, err_msg=figure)
    assert robot.calf_length + robot.foot_radius == pytest.approx(0.245)
    assert stands(DoctorSubject(robot)).result == "ok"


def test_it_walks_with_predictive_control(tmp_path: Path) -> None:
    path = str(written(tmp_path, WRITTEN["dummy root"]))
    env = SimpleQuadVectorEnv(1, robot=path, nthread=1)
    policy = policies.make("mpc_wbc", robot=path)
    observation, _ = env.reset(seed=0, options={"command": np.array([(0.3, 0.0, 0.0)])})
    policy.reset(num_envs=1)
    for _ in range(200):
        observation, _, terminated, _, _ = env.step(policy.act(observation))
        assert not terminated.any()
    assert env.simulation.snapshot(0).qpos[0] == pytest.approx(0.6, abs=0.15)


def cube(half: float) -> str:
    corners = [f"v {x} {y} {z}\n" for x in (-half, half) for y in (-half, half) for z in (-half, half)]
    return "".join(corners) + "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"


def test_meshes_are_found_in_the_package_and_a_missing_one_is_named(tmp_path: Path) -> None:
    """Two files with one name are two meshes; a visual shape may have any format."""
    package = tmp_path / "rover"
    for folder, half in (("seen", 0.05), ("solid", 0.02)):
        (package / folder).mkdir(parents=True)
        (package / folder / "foot.obj").write_text(cube(half), encoding="utf-8")
    files = "seen/foot.obj", "solid/foot.obj", "seen/foot.dae"
    seen, solid, unread = (f'<mesh filename="package://rover/{file}"/>' for file in files)
    shown = shape(seen, "0 0 -0.22", "visual") + shape(unread, kind="visual")
    model = urdf(calf=shown + shape(solid, "0 0 -0.22"))
    robot = Robot.from_mjcf(written(package / "urdf", model))
    assert robot.calf_length + robot.foot_radius == pytest.approx(0.24, abs=1e-6)
    for name, said in (
        ("solid/leg.obj", "the mesh 'package://rover/solid/leg.obj' is no file"),
        ("solid/foot.dae", r"convert 'package://rover/solid/foot.dae', which collides, to \.stl"),
    ):
        with pytest.raises(ModelError, match=said):
            Robot.from_mjcf(written(package / "urdf", model.replace("solid/foot.obj", name)))
