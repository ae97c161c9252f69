"""Parameters of SimpleQuad on robots of other sizes: equal in the robot's own lengths, masses and times."""

import ast
import inspect
import re
import textwrap
from dataclasses import fields
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import policies
from policies.gaits.parameters import GaitParameters
from policies.mpc.parameters import MpcParameters
from policies.parameters import Parameters, scaled_parameters, scaled_ranges
from policies.residual_bases import BASES
from policies.trot.integral import IntegralParameters
from policies.trot.open_loop import SEARCH_RANGES, TrotParameters, searched_parameters
from policies.virtual_model.parameters import VirtualParameters
from quad_env import OBSERVATION, scenario
from quad_env.robots import similarity
from quad_env.robots.robot import Robot
from quad_env.robots.similarity import scale_factor, scaled_servo_gains
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.quad_env.robots.alike import alike
from tests.quad_env.robots.made import Made
from train.config import DEFAULTS

LONGER, HEAVIER = 0.4, 0.1


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return alike(tmp_path_factory.mktemp("small"), LONGER, HEAVIER)


def test_servos_pose_and_speed_of_an_imported_robot_are_those_of_a_simple_quad_of_its_size(small: Robot) -> None:
    assert small.leg_length == pytest.approx(LONGER * SIMPLE_QUAD.leg_length)
    assert small.mass == pytest.approx(HEAVIER * SIMPLE_QUAD.mass)
    for name, unit in (("servo_stiffness", "N·m"), ("rated_torque", "N·m"), ("rated_speed", "rad/s")):
        assert getattr(small, name) == pytest.approx(scale_factor(small, unit) * getattr(SIMPLE_QUAD, name)), name
    assert small.servo_stiffness == pytest.approx(scaled_servo_gains(small)[0])
    assert small.servo_damping == pytest.approx(scaled_servo_gains(small)[1])
    np.testing.assert_allclose(small.home_pose, SIMPLE_QUAD.home_pose, atol=1e-6)


MADE_OF = {
    "m/s": {"m": 1, "s": -1},
    "m/s²": {"m": 1, "s": -2},
    "N": {"kg": 1, "m/s²": 1},
    "N·s": {"kg": 1, "m/s": 1},
    "N·m": {"N": 1, "m": 1},
    "rad/s": {"s": -1},
    "rad/s²": {"s": -2},
    "Hz": {"s": -1},
    "1/s": {"s": -1},
    "1/s²": {"s": -2},
    "1/m": {"m": -1},
    "1/m²": {"m": -2},
    "1/(m/s)": {"m/s": -1},
    "1/N²": {"N": -2},
    "s²": {"s": 2},
    "s²/m²": {"m/s": -2},
    "s⁴": {"s": 4},
    "s⁴/m²": {"m/s²": -2},
}


def test_a_unit_goes_as_what_it_is_made_of_and_the_froude_number_stays(small: Robot) -> None:
    for unit, product in MADE_OF.items():
        made = np.prod([scale_factor(small, each) ** power for each, power in product.items()])
        assert scale_factor(small, unit) == pytest.approx(made), unit
        assert scale_factor(SIMPLE_QUAD, unit) == 1.0
    assert scale_factor(small, "m/s²") == 1.0
    assert scale_factor(small, "m/s") ** 2 / scale_factor(small, "m") == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["trot", "trot_integral"])
def test_a_trot_moves_both_robots_alike_in_their_own_time(name: str, small: Robot) -> None:
    """Any parameter with a wrong unit, and any unscaled constant in the code, changes the angles."""
    time = scale_factor(small, "s")
    ours, theirs = (
        policies.make(name, robot=r, control_period=0.01 * t) for r, t in ((SIMPLE_QUAD, 1.0), (small, time))
    )
    for policy in (ours, theirs):
        policy.reset(num_envs=3)
    table = {"linear_velocity": ("m/s", 0.3), "angular_velocity": ("rad/s", 0.5), "joint_velocity": ("rad/s", 1.0)}
    for tick in range(200):
        seen = np.zeros((3, 48), np.float32)
        seen[:, OBSERVATION["projected_gravity"]] = (0.0, 0.0, -1.0)
        seen[:, OBSERVATION["command"]] = ((0.5, 0.1, 0.3), (0.0, 0.0, 0.0), (-0.4, 0.3, -1.1))
        felt = seen.copy()
        for term, (unit, size) in table.items():
            part = OBSERVATION[term]
            seen[:, part] = size * np.sin(0.05 * tick + np.arange(part.stop - part.start))
            felt[:, part] = scale_factor(small, unit) * seen[:, part]
        felt[:, OBSERVATION["command"]] *= [scale_factor(small, unit) for unit in ("m/s", "m/s", "rad/s")]
        np.testing.assert_allclose(theirs.act(felt), ours.act(seen), atol=2e-6)


def test_simple_quads_own_parameters_are_left_alone() -> None:
    found = searched_parameters()
    assert scaled_parameters(found, SIMPLE_QUAD) == found
    assert scaled_ranges(SEARCH_RANGES, TrotParameters, SIMPLE_QUAD) == SEARCH_RANGES


def test_feet_that_stand_under_their_hips_do_so_on_every_robot(tmp_path: Path) -> None:
    robot = Robot.from_mjcf(Made().write(tmp_path))
    straight, apart = 0.5 * (SIMPLE_QUAD.hip_positions[0, 1] + SIMPLE_QUAD.hip_offset), 0.1 + 0.08
    assert similarity.scale_to_robot(robot, 4.0 * straight, similarity.LATERAL_LENGTH) == pytest.approx(2.0 * apart)
    beyond = similarity.scale_to_robot(robot, 4.0 * straight + 0.1, similarity.LATERAL_LENGTH) - 2.0 * apart
    assert beyond == pytest.approx(0.1 * robot.leg_length / SIMPLE_QUAD.leg_length)
    assert similarity.scale_to_robot(robot, 0.5, similarity.LONGITUDINAL_LENGTH) == pytest.approx(0.4)


def test_a_robot_that_stands_lower_walks_lower_and_steps_as_fast_as_animals_of_its_mass(tmp_path: Path) -> None:
    robot = Robot.from_mjcf(Made().write(tmp_path), home_pose=np.tile((0.0, 0.9, -1.8), 4))
    assert robot.home_hip_height < 0.7 * robot.leg_length  # 0.88 for SimpleQuad
    share = searched_parameters(robot).body_height / robot.home_hip_height
    assert share == pytest.approx(searched_parameters().body_height / SIMPLE_QUAD.home_hip_height)
    frequencies = scaled_ranges(SEARCH_RANGES, TrotParameters, robot)["frequency"]
    slower = (robot.mass / SIMPLE_QUAD.mass) ** -0.14
    assert frequencies == pytest.approx([slower * end for end in SEARCH_RANGES["frequency"]])


def test_what_hangs_on_the_knees_is_the_other_way_round_where_they_bend_forward(tmp_path: Path) -> None:
    backward, forward = (
        Robot.from_mjcf(Made(knees=(knees, knees)).write(tmp_path, f"{knees}.xml")) for knees in (-1, 1)
    )
    ours, theirs = (searched_parameters(robot) for robot in (backward, forward))
    for name in ("stance_shift", "forward_bias", "yaw_per_lateral"):
        assert getattr(theirs, name) == pytest.approx(-getattr(ours, name)) != 0.0, name
    assert theirs.body_height == pytest.approx(ours.body_height)
    low, high = scaled_ranges(SEARCH_RANGES, TrotParameters, forward)["stance_shift"]
    assert low < theirs.stance_shift < high


UNIT = re.compile(r"[, ](Hz per m/s|m/s²|rad/s²|m/s|rad/s|rad/m|1/s²|1/s|1/m|s⁴/m²|s⁴/rad²|1/N²|Hz|N|s|m)(?=[.:;,]|$)")
SAME = {
    "rad/m": "1/m",
    "Hz per m/s": "1/m",
    "s⁴/rad²": "s⁴",
    similarity.LATERAL_LENGTH: "m",
    similarity.LONGITUDINAL_LENGTH: "m",
} | {similarity.HIP_HEIGHT: "m"}
"""Unit -> the unit of the same dimension."""


def told_units(kind: type[Parameters]) -> dict[str, str]:
    """Return the unit at the end of each field's docstring or of its first sentence.

    Fields without a unit are absent.
    """
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
    assert isinstance(tree, ast.ClassDef)
    units = {}
    for field, said in pairwise(tree.body):
        if isinstance(field, ast.AnnAssign) and isinstance(said, ast.Expr) and isinstance(field.target, ast.Name):
            found = UNIT.findall(str(ast.literal_eval(said.value)).split(": ")[0].rstrip("."))
            if found:
                units[field.target.id] = found[-1]
    return units


KINDS = TrotParameters, IntegralParameters, VirtualParameters, GaitParameters, MpcParameters


@pytest.mark.parametrize("kind", KINDS)
def test_the_unit_of_a_parameter_is_the_one_that_its_docstring_tells(kind: type[Parameters]) -> None:
    units = {field.name: field.metadata["unit"] for field in fields(kind)}
    told = told_units(kind)
    assert len(told) >= 5
    for name, unit in told.items():
        own = units[name].removesuffix(similarity.KNEE_SIGN_SUFFIX)
        assert SAME.get(own, own) == SAME.get(unit, unit), name


@pytest.mark.parametrize(("longer", "heavier"), [(0.2, 0.005), (3.0, 40.0)])
def test_robots_of_every_size_have_policies_scenarios_and_a_training(
    longer: float, heavier: float, tmp_path: Path
) -> None:
    robot = alike(tmp_path, longer, heavier)
    for name in BASES:
        assert policies.make(name, robot=robot, servo="own").robot == robot
    for name, _ in DEFAULTS["residual"].mixture:
        assert scenario(name, robot).name


def test_a_size_beyond_any_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(policies.PolicyError, match=r"SimpleQuad's parameters are none for alike: .* must be finite"):
        policies.make("mpc", robot=alike(tmp_path, 40.0, 60_000.0))
