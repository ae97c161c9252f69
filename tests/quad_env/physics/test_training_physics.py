"""Options of the training physics change the fields of the model that they name, and no others."""

from typing import Any

import mujoco
import numpy as np
import pytest

from quad_env import SIMPLE_QUAD, TaskConfig
from quad_env.config import PhysicsOptions
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.physics.model import compile_model
from quad_env.robots.part_names import foot_geoms
from quad_env.robots.registry import ROBOTS
from quad_env.robots.robot import Robot
from quad_env.scenarios.registry import scenario


def changed_fields(robot: Robot, **options: Any) -> tuple[set[str], mujoco.MjModel]:
    """Return the names of the model's arrays and options that differ from the full model, and the model."""
    timestep, iterations = options.pop("timestep", None), options.pop("solver_iterations", None)
    plain = compile_model(robot, scenario("flat"))
    model = compile_model(
        robot, scenario("flat"), timestep=timestep, solver_iterations=iterations, options=PhysicsOptions(**options)
    )
    names = [name for name in dir(plain) if isinstance(getattr(plain, name), np.ndarray)]
    changed = {name for name in names if not np.array_equal(getattr(plain, name), getattr(model, name))}
    opt = [name for name in dir(plain.opt) if isinstance(getattr(plain.opt, name), int | float)]
    return changed | {name for name in opt if getattr(plain.opt, name) != getattr(model.opt, name)}, model


@pytest.fixture(params=["simple_quad", "go1"])
def robot(request: pytest.FixtureRequest) -> Robot:
    return SIMPLE_QUAD if request.param == "simple_quad" else ROBOTS[request.param]


def test_without_options_nothing_changes(robot: Robot) -> None:
    assert changed_fields(robot)[0] == set()


@pytest.mark.parametrize(
    ("options", "fields"),
    [
        ({"joint_friction": "none"}, {"dof_frictionloss"}),
        ({"timestep": 0.005}, {"timestep"}),
        ({"solver_iterations": 10}, {"iterations"}),
    ],
)
def test_an_option_changes_its_field_alone(options: dict[str, Any], fields: set[str], robot: Robot) -> None:
    changed, model = changed_fields(robot, **options)
    has_friction = compile_model(robot, scenario("flat")).dof_frictionloss.any()
    assert changed == fields - (set() if has_friction else {"dof_frictionloss"})
    assert options.get("joint_friction") != "none" or not model.dof_frictionloss.any()


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
def test_the_cone_is_the_one_named(cone: str, robot: Robot) -> None:
    changed, model = changed_fields(robot, cone=cone)
    assert changed <= {"cone"}
    assert model.opt.cone == {"pyramidal": 0, "elliptic": 1}[cone]


@pytest.mark.parametrize("contacts", ["feet", "feet-trunk"])
def test_only_the_named_geoms_collide_with_the_ground(contacts: str, robot: Robot) -> None:
    changed, model = changed_fields(robot, contacts=contacts)
    assert changed <= {"geom_contype", "geom_conaffinity"}
    collides = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    feet = {geom for leg in robot.leg_names for geom in foot_geoms(model, leg)}
    trunk = {geom for geom in range(model.ngeom) if model.geom_bodyid[geom] == model.body("base_link").id}
    ground = {geom for geom in range(model.ngeom) if model.geom_bodyid[geom] == 0}
    colliding = set(np.flatnonzero(collides).tolist())
    assert feet
    assert ground <= colliding | ground
    assert feet <= colliding
    others = colliding - feet - ground
    assert others <= trunk if contacts == "feet-trunk" else not others
    assert bool(others) == (contacts == "feet-trunk")


@pytest.mark.parametrize("contacts", ["feet", "feet-trunk", "all"])
def test_a_robot_that_lies_on_its_trunk_is_held_only_if_the_trunk_collides(contacts: str) -> None:
    """The robot lies with its legs straight up, and falls through the ground if only feet collide."""
    task = TaskConfig(physics=PhysicsOptions(contacts=contacts))  # type: ignore[arg-type]
    robots = SimpleQuadVectorEnv(1, scenario("flat"), config=task, terminate_on_fall=False)
    robots.reset(seed=0)
    simulation = robots.simulation
    simulation.qpos[0, :7] = (0.0, 0.0, 0.3, 0.0, 1.0, 0.0, 0.0)
    for _ in range(60):
        robots.step(np.array(SIMPLE_QUAD.home_pose, np.float32)[None])
    height = float(simulation.qpos[0, 2])
    robots.close()
    assert (height < -0.2) == (contacts == "feet")
