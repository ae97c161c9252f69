"""Actuators by name and value, measured on the whole robot: curve, gear, lag, delay, heat."""

import math

import gymnasium as gym
import numpy as np
import pytest

import policies
from quad_env.actuation.models import Actuator, Thermal, TorqueSpeed
from quad_env.physics.simulation import Simulation, SimulationConfig
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.disturbances import Motors
from quad_env.scenarios.scenario import Scenario

SUBSTEP = 0.002
EVERY_SUBSTEP, EVERY_CONTROL_STEP = 500.0, 100.0
CURVE = TorqueSpeed(100.0, 10.0)
HOT = Thermal(resistance=2.0, time_constant=2.0, derated=0.25)
"""Motor that heats up by 2 K per physics step at standstill."""


def simulate(actuator: Actuator, rate: float = EVERY_SUBSTEP, motors: Motors | None = None) -> Simulation:
    simulation = Simulation(
        SIMPLE_QUAD,
        Scenario("made", motors=motors or Motors()),
        SimulationConfig(control_rate=rate, actuator=actuator),
    )
    simulation.reset(np.arange(1), np.zeros((1, 35)))
    return simulation


def wild(steps: int) -> np.ndarray:
    """Return random targets within the joint limits, (steps, 1, 12), rad."""
    return np.random.default_rng(0).uniform(SIMPLE_QUAD.joint_lower, SIMPLE_QUAD.joint_upper, (steps, 1, 12))


def motion(simulation: Simulation) -> np.ndarray:
    return np.concatenate([simulation.qpos[0], simulation.qvel[0]])


def torque_at(speed: float, target: np.ndarray, actuator: Actuator, motors: Motors | None = None) -> np.ndarray:
    """Return the torques at the first physics step, with the joints in the middle of their range at a given speed."""
    simulation = simulate(actuator, motors=motors)
    simulation.qpos[0, 7:] = (SIMPLE_QUAD.joint_lower + SIMPLE_QUAD.joint_upper) / 2
    simulation.qvel[0, 6:] = speed
    simulation.step(target[None], None)
    return simulation.torque[0]


@pytest.mark.parametrize(
    ("speed", "torque"),
    [(0.0, 100.0), (2.5, 75.0), (9.0, 10.0), (10.0, 0.0), (12.0, -20.0), (25.0, -100.0), (-0.5, 100.0), (-8.0, 100.0)],
)
def test_the_largest_torque_lies_on_the_curve_and_braking_is_held_to_the_current_limit(
    speed: float, torque: float
) -> None:
    """A positive speed with an upward target drives, a negative speed brakes.

    Only braking is possible above 10 rad/s.
    """
    stiff = Simulation(
        SIMPLE_QUAD, Scenario("made"), SimulationConfig(control_rate=EVERY_SUBSTEP)
    ).model.actuator_gainprm[0, 0]
    assert stiff * 0.5 - 10 * 9 >= 10  # an error of 0.5 rad demands more torque than the curve gives up to 9 rad/s
    far = 100 * np.ones(12)
    for sign in (1, -1):
        found = torque_at(sign * speed, sign * far, Actuator(CURVE), None)
        asked = (
            np.clip(sign * far, SIMPLE_QUAD.joint_lower, SIMPLE_QUAD.joint_upper)
            - (SIMPLE_QUAD.joint_lower + SIMPLE_QUAD.joint_upper) / 2
        )
        servo = stiff * asked - 10 * sign * speed
        expected = sign * np.minimum(torque, np.maximum(sign * servo, -100.0))
        np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.parametrize(("stall", "limit", "weaker"), [(100.0, 40.0, 40.0), (30.0, 100.0, 30.0)])
def test_of_two_torque_limits_the_weaker_holds(stall: float, limit: float, weaker: float) -> None:
    simulation = simulate(Actuator(TorqueSpeed(stall, 10.0)), motors=Motors(limit))
    torques = []
    for target in wild(50):
        simulation.step(target, None)
        torques.append(np.abs(simulation.torque).max())
    assert max(torques) == weaker


@pytest.mark.parametrize(
    ("parts", "steps"), [({}, 1), ({"curve": CURVE}, 3), ({"curve": CURVE, "bandwidth": 20.0, "thermal": Thermal()}, 7)]
)
def test_a_delay_is_exact_in_physics_steps(parts: dict, steps: int) -> None:
    """A delayed robot equals an undelayed one whose targets come `steps` physics steps later, after the home pose."""
    late, told_late = (
        simulate(Actuator(**parts, delay=steps * SUBSTEP), EVERY_CONTROL_STEP),
        simulate(Actuator(**parts)),
    )
    targets = wild(12)
    sequence = [SIMPLE_QUAD.home_pose[None]] * steps + [target for target in targets for _ in range(5)]
    for number, target in enumerate(targets):
        late.step(target, None)
        for told in sequence[5 * number : 5 * number + 5]:
            told_late.step(told, None)
        np.testing.assert_array_equal(motion(late), motion(told_late))


def received(simulation: Simulation, target: np.ndarray) -> np.ndarray:
    """Step the simulation, and return the target that its servos used in this physics step, rad."""
    position, speed = simulation.qpos[0, 7:].copy(), simulation.qvel[0, 6:].copy()
    simulation.step(target[None], None)
    return (simulation.torque[0] + 10 * speed) / 300 + position


@pytest.mark.parametrize(
    ("curve", "own", "of_the_scenario"), [(None, 8.0, None), (None, 8.0, 30.0), (CURVE, 30.0, 8.0)]
)
def test_at_the_bandwidth_a_sine_loses_3_decibels_and_45_degrees(
    curve: TorqueSpeed | None, own: float, of_the_scenario: float | None
) -> None:
    """The lower of two bandwidths applies.

    The filter holds its target for a step, which adds the phase of one and a half steps.
    """
    motors = None if of_the_scenario is None else Motors(bandwidth=of_the_scenario)
    simulation = simulate(Actuator(curve, bandwidth=own), motors=motors)
    angle = 2 * math.pi * 8.0 * SUBSTEP * np.arange(1250)  # 20 periods
    found = (
        np.array([received(simulation, SIMPLE_QUAD.home_pose + 0.02 * math.sin(a)) for a in angle])
        - SIMPLE_QUAD.home_pose
    )
    settled = slice(625, None)
    transfer = 2 * np.mean(found[settled] * np.exp(-1j * angle[settled])[:, None], axis=0) / 0.02 * 1j
    np.testing.assert_allclose(20 * np.log10(np.abs(transfer)), -3.01, atol=0.05)
    np.testing.assert_allclose(np.degrees(np.angle(transfer)), -45 - 180 * 8.0 * SUBSTEP, atol=0.5)


def test_windings_heat_at_every_physics_step_by_their_torque() -> None:
    """The first-order response to the recorded torques is summed in closed form; losses are torque² / slope."""
    fine, coarse = (simulate(Actuator(CURVE, thermal=Thermal()), rate) for rate in (EVERY_SUBSTEP, EVERY_CONTROL_STEP))
    torques = []
    for target in wild(60):
        for _ in range(5):
            fine.step(target, None)
            torques.append(fine.torque[0].copy())
        coarse.step(target, None)
    age = SUBSTEP * np.arange(len(torques))[::-1, None]
    share = math.exp(-SUBSTEP / 17.4)
    rise = np.sum(1.07 * np.square(torques) / 10 * (1 - share) * np.exp(-age / 17.4), axis=0)
    np.testing.assert_allclose(fine.winding_temperature[0], 25 + rise, rtol=1e-12)
    np.testing.assert_array_equal(coarse.winding_temperature, fine.winding_temperature)
    assert rise.max() > 1


def test_a_hot_motor_gives_less_then_nothing_until_the_next_episode() -> None:
    """The limit is 100 N·m up to 100 °C, 25 N·m just below 115 °C, then zero."""
    simulation = simulate(Actuator(CURVE, thermal=HOT))
    off, torques = np.zeros(12, bool), []
    held = np.concatenate([[0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0], SIMPLE_QUAD.joint_lower])
    for step in range(2000):
        temperature = simulation.winding_temperature[0]
        off |= temperature >= 115
        limit = np.where(off, 0.0, 25 + 75 * np.clip((115 - temperature) / 15, 0, 1))
        simulation.qpos[0], simulation.qvel[0] = held, 0.0
        simulation.step(SIMPLE_QUAD.joint_upper[None] if step < 1000 else SIMPLE_QUAD.joint_lower[None], None)
        np.testing.assert_allclose(simulation.torque[0], limit if step < 1000 else 0.0, atol=1e-9)
        torques.append(simulation.torque[0, 0])
    assert sum(25 < torque < 99 for torque in torques) > 5
    assert off.all()
    assert (simulation.winding_temperature < 100).all()
    simulation.step(SIMPLE_QUAD.joint_upper[None], None)
    assert (simulation.torque == 0).all()
    assert simulation.snapshot(0).actuator_force == pytest.approx(np.zeros(12))
    simulation.reset(np.arange(1), np.zeros((1, 35)))
    assert (simulation.winding_temperature == 25).all()
    simulation.step(SIMPLE_QUAD.joint_upper[None], None)
    assert (simulation.torque > 20).all()


def test_the_trot_walks_on_the_default_motor() -> None:
    batch = gym.make_vec("quad_env:SimpleQuad-v0", num_envs=4, actuator="motor", autoreset_mode="DISABLED")
    policy = policies.make("trot")
    policy.reset(4)
    observation, _ = batch.reset(seed=2, options={"command": (0.8, 0.0, 0.0)})
    speeds = []
    for _ in range(300):
        observation, _, terminated, _, infos = batch.step(policy.act(observation))
        speeds.append(infos["heading_velocity"][:, 0])
    assert not terminated.any()
    np.testing.assert_allclose(np.mean(speeds[100:], axis=0), 0.8, atol=0.1)


@pytest.mark.parametrize(
    ("parts", "shares"),
    [
        ({}, [1.0]),
        ({"delay": 0.006}, [0.4, 0.6]),
        ({"delay": 0.01}, [0.0, 1.0]),
        # Response of a lag, with 44 % left after a physics step, after 0, 1, … steps, minus one step of delay.
        ({"bandwidth": 66.0, "delay": 0.002}, [0.458, 0.529, 0.012]),
    ],
)
def test_shares_of_past_targets_in_what_motors_go_by(parts: dict[str, float], shares: list[float]) -> None:
    np.testing.assert_allclose(Actuator(**parts).target_weights(0.002, 0.01), shares, atol=1e-3)


def test_a_motor_that_turns_has_less_torque_left_ahead_than_back() -> None:
    line = TorqueSpeed(stall_torque=100.0, no_load_speed=10.0, peak_torque=80.0).resolve(SIMPLE_QUAD)
    least, most = line.limits(np.array([0.0, 5.0, -5.0, 12.0] * 3))
    np.testing.assert_allclose(most[:4], [80.0, 50.0, 80.0, -20.0])
    np.testing.assert_allclose(least[:4], [-80.0, -80.0, -50.0, -80.0])
