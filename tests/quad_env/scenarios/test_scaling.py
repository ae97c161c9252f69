"""A severity level is equal for every robot: scenarios in the robot's own lengths, masses and times."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import policies
from evaluate.commands.options import EvaluateOptions
from evaluate.commands.plan import check
from evaluate.hardware import HardwareConfig
from quad_env import SCENARIOS, SIMPLE_QUAD, Robot, Scenario, scenario
from quad_env.config import GRAVITY
from quad_env.envs.env import SimpleQuadEnv
from quad_env.scenarios.axes import AXES, ROBOT_SCALED_UNITS, axes_of
from quad_env.scenarios.registry import scaled_name, scenarios_of
from quad_env.scenarios.scenario import scaled
from quad_env.task.terminations import fall_reason_code
from tests.batches import begun
from tests.quad_env.robots.alike import alike
from train import validation
from train.commands.run import parse
from train.config import ValidationConfig
from train.training_robots import make_batch

LONGER, HEAVIER = 0.4, 0.1


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return alike(tmp_path_factory.mktemp("small"), LONGER, HEAVIER)


def everything(of: Scenario) -> dict[str, float]:
    """Return all demands of a scenario in its own units."""
    terrain = of.terrain
    found = {
        "forward": of.commands.forward[1],
        "lateral": of.commands.lateral[0],
        "yaw": of.commands.yaw_rate[1],
        "push": of.pushes.impulse if of.pushes else 0.0,
        "force": of.force.force if of.force else 0.0,
        "load": of.payload.mass if of.payload else 0.0,
        "reach": of.payload.reach[0] if of.payload else 0.0,
        "sink": of.ground.sink_depth,
        "torque": of.motors.torque_limit or 0.0,
    }
    sizes = "peak_to_valley", "correlation_length", "half_size", "spawn_radius", "cell", "rise", "run"
    return found | {size: getattr(terrain, size) for size in sizes if hasattr(terrain, size)}


def own(robot: Robot, of: Scenario) -> dict[str, float]:
    """Return these demands relative to the robot: leg length, weight, and the speed of a fall from its own height."""
    speed, weight = np.sqrt(GRAVITY * robot.leg_length), robot.mass * GRAVITY
    by = dict.fromkeys(("forward", "lateral"), speed) | {
        "yaw": speed / robot.leg_length,
        "push": robot.mass * speed,
        "force": weight,
        "load": robot.mass,
        "torque": weight * robot.leg_length,
    }
    return {name: value / by.get(name, robot.leg_length) for name, value in everything(of).items()}


def test_every_level_is_as_hard_for_a_small_robot(small: Robot) -> None:
    levels = [(axis, number + 1) for axis in AXES.values() if axis.scales for number in range(len(axis.levels))]
    for axis, number in levels:
        ours, theirs = axis.level(number), axes_of(small)[axis.name].level(number)
        assert ours.name == theirs.name
        assert own(small, theirs) == pytest.approx(own(SIMPLE_QUAD, ours)), theirs
        for same in ("latency", "noise", "dropouts"):
            assert getattr(theirs, same) == getattr(ours, same)
        assert theirs.ground.friction == ours.ground.friction
        assert theirs.motors.bandwidth == ours.motors.bandwidth


def test_severities_are_physical(small: Robot) -> None:
    for name, ours in AXES.items():
        theirs = axes_of(small)[name]
        ratio = theirs.level(2).severity / ours.level(2).severity
        assert (ratio == 1.0) == (ours.unit not in ROBOT_SCALED_UNITS or not ours.scales)
        assert theirs.level(2).severity_unit == ours.unit
        assert theirs.harder_when_smaller == ours.harder_when_smaller
    push = axes_of(small)["push"].level(2)
    assert push.pushes.impulse == pytest.approx(push.severity)


def test_slow_commands_are_those_of_the_rule_of_success_for_every_robot(small: Robot) -> None:
    assert [name for name, axis in AXES.items() if not axis.scales] == ["slow"]
    for name in ("slow", "slow=0.05"):
        assert scenario(name, small) == scenario(name)
    assert scaled_name("slow=0.05", small) == "slow=0.05"


def test_simple_quads_scenarios_are_the_very_ones_that_they_were(small: Robot) -> None:
    assert all(scaled(each, SIMPLE_QUAD) is each for each in SCENARIOS.values())
    assert all(axis.for_robot(SIMPLE_QUAD) is axis for axis in AXES.values())
    scenarios_of.cache_clear()  # the cache is full after scenarios of many robots
    assert scenario("push") is SCENARIOS["push"]
    assert scenario("push").pushes.impulse == 35.0
    assert scenario("push", small) != SCENARIOS["push"]
    assert scenario("push:3", small) == axes_of(small)["push"].level(3)


def test_what_a_user_writes_in_physical_units_stays_as_it_is(small: Robot) -> None:
    assert scenario("push=42", small).pushes.impulse == pytest.approx(42.0)
    assert scenario("flat", small).commands == scenario("push", small).commands
    both = scenario("payload=0.5+rough=0.03", small)
    assert both.payload.mass == pytest.approx(0.5)
    assert both.terrain.peak_to_valley == pytest.approx(0.03)
    assert both.commands == scenario("flat", small).commands
    mine = Scenario("mine", pushes=SCENARIOS["push"].pushes)
    assert scenario(mine, small) is mine


def test_a_physical_name_can_be_said_for_another_robot(small: Robot) -> None:
    assert scaled_name("payload=20+slope=10", small) == "payload=2+slope=10"
    assert scaled_name("push", small) == "push"
    assert scaled_name("payload=20+slope=10+hardware", small) == "payload=2+slope=10+hardware"
    assert scaled_name("payload=20", SIMPLE_QUAD) == "payload=20"
    assert scaled_name("payload=20+randomised+hardware", small) == "payload=2+randomised+hardware"


def test_of_domain_randomisation_lengths_are_the_robots_own_and_shares_the_same(small: Robot) -> None:
    ours, theirs = (scenario("push+randomised", robot).randomisation for robot in (SIMPLE_QUAD, small))
    assert theirs.centre_of_mass == pytest.approx([LONGER * each for each in ours.centre_of_mass])
    assert replace(theirs, centre_of_mass=ours.centre_of_mass) == ours
    assert scaled(scenario("push+randomised"), small).randomisation == theirs


def test_no_motor_gets_more_torque_than_it_has(small: Robot) -> None:
    weak = replace(small, name="weak", rated_torque=0.5)
    assert axes_of(weak)["weak_motors"].level(1).motors.torque_limit == 0.5


def test_an_evaluation_and_a_training_take_it(small: Robot, tmp_path: Path) -> None:
    path = str(small.source)
    plan = check(EvaluateOptions(policies=("trot",), scenarios=("default",), robot=path, out=tmp_path / "out"))
    assert [each.name for each in plan.scenarios][:3] == ["flat", "push", "rough"]
    of_axes = [each for each in plan.scenarios if each.axis and not each.hardware]
    assert all(each == axes_of(small)[each.axis].scenario(each.severity, each.name) for each in of_axes)
    assert plan.policies[0].policy.robot == small
    config = parse(["--robot", path])
    place = [name for name, _ in config.mixture].index("payload:4")
    batch = make_batch(config, place, 1.0)
    assert batch.robot == small
    assert batch.scenario.payload.mass == pytest.approx(0.1 * AXES["payload"].levels[3])
    assert batch.scenario.commands == scenario("flat", small).commands
    batch.close()
    place = [name for name, _ in config.mixture].index("rough:3")
    mild = make_batch(parse(["--robot", path, "--curriculum", "0.0"]), place, 0.0)
    assert mild.scenario.terrain.peak_to_valley == pytest.approx(0.4 * AXES["rough"].levels[0])
    mild.close()


def test_a_validation_is_on_the_robots_own_ground(small: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """The test checks the scenario and the robot at the call site."""
    monkeypatch.setattr(validation, "run", partial(validation.run, steps=101))
    chosen, hardware = ValidationConfig(episodes=1, scenarios=("push",)), HardwareConfig(robot=str(small.source))
    with begun() as found:
        validation.validate(policies.make("trot", robot=small), chosen, 1, hardware)
    assert [(batch.env.scenario, batch.env.robot) for batch in found] == [(scenario("push", small), small)]


def test_a_fall_is_judged_by_the_robots_own_height(small: Robot) -> None:
    env = SimpleQuadEnv(robot=small, terminate_on_fall=False)
    assert env.config.fall_rule.min_trunk_height(small.leg_length) == pytest.approx(0.2 * small.leg_length)
    assert env.config.fall_rule.min_trunk_height(SIMPLE_QUAD.leg_length) == 0.12
    env.reset(seed=0)
    for height, code in ((0.9, 3), (1.1, 0)):
        state = env.simulation.state((0.0, 0.0, 0.0), None)._replace(height=height * 0.2 * small.leg_length)
        assert fall_reason_code(state, env.config.fall_rule, env._min_trunk_height) == code
    env.close()
