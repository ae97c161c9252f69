"""A joint is at its anchor, not at the frame of its body; a robot with non-finite numbers is refused."""

from pathlib import Path

import numpy as np
import pytest

from quad_env.envs.vector_env import SimpleQuadVectorEnv
from tests.quad_env.robots.made import PLACES, Made
from tests.quad_env.robots.test_model_files import robot_of_text, standing

INERTIAL = '<inertial pos="{} {} {}" mass="0.4" diaginertia="0.002 0.002 0.002"/>'
RANGES = "-0.8 0.8", "-1.6 1.6", "-2.5 -0.3"


def model_of(in_the_joints: bool) -> str:
    """Return a quadruped with its bodies at the joints, or with all bodies at the origin of the trunk."""
    model = Made().xml()
    head = model[: model.index('<body pos="0.2')]
    tail = model[model.index("</body></worldbody>") :]
    legs = ""
    for leg in ("fr", "fl", "hr", "hl"):
        ahead, left = PLACES[leg]
        places = np.cumsum(((0.2 * ahead, 0.1 * left, 0.0), (0.0, 0.08 * left, 0.0), (0.0, 0.0, -0.2)), axis=0)
        before = np.zeros(3)
        for number, place in enumerate(places):
            moved, anchor = (place - before, np.zeros(3)) if in_the_joints else (np.zeros(3), place)
            before = place
            legs += f'<body pos="{text(moved)}">{INERTIAL.format(*anchor)}<joint name="{Made().names[leg]}{number}" '
            legs += f'pos="{text(anchor)}" axis="{int(number == 0)} {int(number > 0)} 0" armature="0.01" '
            legs += f'range="{RANGES[number]}"/>'
            if number == 1:
                x, y, z = anchor
                legs += f'<geom type="capsule" size="0.018" fromto="{x} {y} {z - 0.03} {x} {y} {z - 0.18}"/>'
        x, y, z = anchor
        legs += f'<geom type="sphere" size="0.025" pos="{x} {y} {z - 0.22}"/></body></body></body>'
    return head + legs + tail


def text(place: np.ndarray) -> str:
    return " ".join(repr(float(each)) for each in place)


def test_bodies_at_the_origin_with_joints_elsewhere_are_the_same_robot(tmp_path: Path) -> None:
    usual, other = (robot_of_text(tmp_path, model_of(kind), f"{kind}.xml", name="made") for kind in (True, False))
    assert usual.thigh_radius == pytest.approx(0.03)
    for name, value in usual.by_name.items():
        if isinstance(value, float | np.ndarray):
            np.testing.assert_allclose(getattr(other, name), value, atol=1e-9, err_msg=name)
    assert other.mass == pytest.approx(usual.mass)
    np.testing.assert_allclose(other.joint_lower, usual.joint_lower, atol=1e-12)
    standing(other)


@pytest.mark.parametrize("scenario", ["flat", "stairs"])
def test_a_robot_with_such_joints_starts_where_the_usual_one_does(scenario: str, tmp_path: Path) -> None:
    starts = []
    for kind in (True, False):
        env = SimpleQuadVectorEnv(3, scenario, robot=robot_of_text(tmp_path, model_of(kind), f"{kind}.xml"), nthread=1)
        env.reset(seed=2)
        starts.append(env.simulation.qpos.copy())
    np.testing.assert_allclose(*starts, atol=1e-9)
