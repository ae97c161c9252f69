"""Motor energy of a control step, by hand, for rows of a batch, and only on request."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from quad_env.actuation.models import Actuator, Thermal, TorqueSpeed
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.physics.energy import JOINT_READINGS, MotorMeter, sum_foot_forces
from quad_env.physics.simulators import SimulatorFeatures
from quad_env.robots.simple_quad import SIMPLE_QUAD

MEASURED = (*JOINT_READINGS, "foot_impulse")
HOME = SIMPLE_QUAD.home_pose.astype(np.float32)


class Batch:
    """Two robots with prescribed physics; the first of twelve joints moves."""

    def __init__(self) -> None:
        self.fields = {name: np.zeros((2, 18)) for name in ("qvel", "qDeriv")} | {"actuator_force": np.zeros((2, 12))}
        self.touch = np.zeros((2, 1))
        self.features = SimulatorFeatures()

    def bind(self, name: str) -> np.ndarray:
        return self.fields[name]

    def sensor(self, _: str) -> Any:
        return SimpleNamespace(data=self.touch)


def metered(actuator: Actuator) -> tuple[Batch, MotorMeter]:
    """Return a batch and its meter: physics steps of 0.1 s, joint damping 0.5 N·m·s/rad, motor damping 2 N·m·s/rad."""
    batch = Batch()
    batch.fields["qDeriv"][:, 6:] = -2.5
    model = SimpleNamespace(
        opt=SimpleNamespace(timestep=0.1),
        actuator_forcerange=np.tile([-80.0, 80.0], (12, 1)),
        dof_damping=np.full(18, 0.5),
        D_rowadr=np.arange(18),
        D_diag=np.zeros(18, int),
    )
    return batch, MotorMeter(SIMPLE_QUAD, batch, model, actuator)


def test_a_control_step_by_hand() -> None:
    """The torques are 10 − 2 · 1 and −3 − 2 · (−4) N·m at mean speeds of 0.5 and −1 rad/s; only robot 0 is stepped."""
    batch, meter = metered(Actuator(TorqueSpeed(40.0, 10.0)))
    steps = iter([(10.0, 1.0, 30.0), (-3.0, -3.0, 50.0)])

    def step(ids: Any) -> None:
        batch.fields["actuator_force"][0, 0], batch.fields["qvel"][0, 6], batch.touch[0] = next(steps)
        meter.record(ids)

    meter.reset(np.arange(2))
    meter.start(np.array([0]))
    step(np.array([0]))
    step(np.array([0]))
    meter.finish(np.array([0]))
    found = {name: reading[0, 0] for name, reading in meter.readings.items()}
    assert found == pytest.approx(
        {
            "positive_work": 0.1 * 8.0 * 0.5,
            "regeneration": 0.1 * 5.0 * 1.0,
            "joule_heat": 0.1 * (8.0**2 + 5.0**2) / (40.0 / 10.0),
            "mean_torque": (8.0 + 5.0) / 2,
            "peak_torque": 8.0,
            "peak_speed": 3.0,
            "torque_change": (8.0 + 5.0) / 2,
            "foot_impulse": 0.1 * (30.0 + 50.0),
        }
    )
    assert not any(reading[1].any() for reading in meter.readings.values())
    assert (meter.torque_limit.tolist(), meter.speed_limit.tolist()) == ([80.0] * 12, [10.0] * 12)
    steps = iter([(4.0, -3.0, 0.0)])
    meter.start(slice(None))
    step(slice(None))
    meter.finish(slice(None))
    assert meter.readings["torque_change"][0, 0] == pytest.approx(6.5 - 4.0)
    assert meter.readings["foot_impulse"][0, 0] == 0.0


def test_the_change_of_a_robot_s_torque_is_from_its_own_before_where_it_moves_alone() -> None:
    """The torque of robot 1 changes from 0 to 7 and then to 4 N·m, while robot 0 stays at 5 N·m."""
    batch, meter = metered(Actuator())
    both = np.arange(2)
    for ids, torques, changes in (([0, 1], [5.0, 7.0], [5.0, 7.0]), ([1], [0.0, 4.0], [5.0, 3.0])):
        batch.fields["actuator_force"][:, 2] = torques
        meter.start(np.array(ids))
        meter.record(np.array(ids))
        meter.finish(np.array(ids))
        assert meter.readings["torque_change"][both, 2].tolist() == changes
    assert meter.readings["peak_torque"][both, 2].tolist() == [5.0, 4.0]


def test_motors_without_a_curve_have_no_heat_and_the_rated_speed() -> None:
    _, meter = metered(Actuator())
    meter.start(slice(None))
    meter.record(slice(None))
    meter.finish(slice(None))
    assert np.isnan(meter.readings["joule_heat"]).all()
    assert meter.speed_limit.tolist() == [SIMPLE_QUAD.rated_speed] * 12


HOT = Actuator(TorqueSpeed(), bandwidth=66.0, delay=0.002, thermal=Thermal(derating=29.0, shutdown=32.0))
"""Motors that begin to lose torque 4 °C above the ambient temperature."""


@pytest.mark.parametrize(
    ("options", "calls_one_by_one"),
    [
        ({"scenario": "rough"}, "none"),
        ({"scenario": "rough+hardware"}, "none"),
        ({"scenario": "push", "actuator": "motor"}, "none"),
        ({"scenario": "flat", "actuator": HOT}, "some"),
        ({"scenario": "flat", "actuator": HOT, "readings": False}, "some"),
        ({"scenario": "flat", "actuator": Actuator(TorqueSpeed(), bandwidth=66.0), "readings": False}, "none"),
    ],
)
def test_steps_in_one_call_or_one_by_one_have_the_same_bits(options, calls_one_by_one: str, monkeypatch) -> None:
    """Robots with warnings and robots with hot motors are stepped one by one."""
    rng = np.random.default_rng(0)
    actions = HOME + rng.uniform(-0.6, 0.6, (40, 3, 12))
    names = (*JOINT_READINGS, "foot_impulse", "joint_position") if options.get("readings", True) else ()
    found = []
    for in_one_call in (True, False):
        env = SimpleQuadVectorEnv(3, **{"readings": True, "autoreset_mode": "DISABLED"} | options)
        assert env.simulation._records_all_steps
        monkeypatch.setattr(env.simulation, "_records_all_steps", in_one_call)
        calls: list[int] = []
        true = env.simulation._step_physics
        monkeypatch.setattr(env.simulation, "_step_physics", lambda ids, n: (calls.append(n), true(ids, n)))  # noqa: B023
        env.reset(seed=3)
        results = [env.step(action) for action in actions]
        if in_one_call:
            expected_calls = range(1, 5 * len(actions)) if calls_one_by_one == "some" else range(1)
            assert len(calls) in expected_calls
        else:
            assert calls == [1] * 5 * len(actions)
        found.append([result[0] for result in results] + [result[4][name] for result in results for name in names])
        if env.simulation.winding_temperature is not None:
            found[-1].append(env.simulation.winding_temperature)
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("row", [slice(1, 2), slice(0, 2)])
def test_robots_with_a_warning_are_stepped_one_by_one_with_the_same_bits(row: slice, monkeypatch) -> None:
    """Robot 1 gets a velocity at which MuJoCo warns; the call stops stepping it, and is repeated step by step."""
    found = []
    for in_one_call in (True, False):
        env = SimpleQuadVectorEnv(3, readings=True, autoreset_mode="DISABLED", terminate_on_fall=False)
        monkeypatch.setattr(env.simulation, "_records_all_steps", in_one_call)
        env.reset(seed=0)
        action = np.tile(HOME, (3, 1))
        env.step(action)
        env.simulation.qvel[row, 8] = 1e11
        infos = [env.step(action)[4] for _ in range(3)]
        assert infos[0]["diverged"][row].all()
        assert not infos[0]["diverged"][2]
        found.append([info[name] for info in infos for name in (*JOINT_READINGS, "foot_impulse", "joint_position")])
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)


def test_readings_alone_need_every_physics_step(monkeypatch) -> None:
    for readings, lengths in ((False, [5]), (True, [])):
        env, taken = SimpleQuadVectorEnv(2, readings=readings), []
        env.reset(seed=0)
        true = env.simulation._step_physics
        monkeypatch.setattr(env.simulation, "_step_physics", lambda ids, n: (taken.append(n), true(ids, n)))  # noqa: B023
        env.step(np.tile(HOME, (2, 1)))
        assert taken == lengths
        assert (env.simulation.meter is None) != readings


def test_readings_are_the_same_with_sensors_that_look_at_the_physics_again() -> None:
    """An IMU lets MuJoCo compute torques and contacts of the present state."""
    blind, sensing = (SimpleQuadVectorEnv(2, readings=True, sensors=sensors) for sensors in (None, "typical"))
    for env in (blind, sensing):
        env.reset(seed=1, options={"command": (0.5, 0.0, 0.0)})
    rng = np.random.default_rng(0)
    for _ in range(20):
        action = HOME + rng.uniform(-0.3, 0.3, (2, 12)).astype(np.float32)
        one, other = blind.step(action)[-1], sensing.step(action)[-1]
        for name in MEASURED:
            np.testing.assert_array_equal(one[name], other[name], err_msg=name)


def test_a_robot_that_does_not_move_keeps_its_readings_and_a_new_episode_begins_with_none() -> None:
    env = SimpleQuadVectorEnv(2, readings=True, autoreset_mode="DISABLED", actuator="torque_speed")
    env.reset(seed=0)
    for _ in range(20):
        infos = env.step(np.tile(HOME, (2, 1)))[-1]
    env.simulation.qvel[1, 3] = 1e30  # the robot diverges and is reset to the home pose
    parked = env.step(np.tile(HOME, (2, 1)))[-1]
    assert parked["diverged"].tolist() == [False, True]
    later = env.step(np.tile(HOME, (2, 1)))[-1]
    for name in MEASURED:
        assert infos[name][1].any(), name
        np.testing.assert_array_equal(parked[name][1], 0.0)
        np.testing.assert_array_equal(later[name][1], 0.0)
        assert later[name][0].any(), name
    _, begun = env.reset(options={"reset_mask": np.array([True, False])})
    assert not any(begun[name].any() for name in MEASURED)


def test_the_first_step_after_a_reset_is_measured_as_that_of_a_robot_that_has_done_nothing_before() -> None:
    """The torque change of the other robot is relative to its previous step."""
    used, fresh = (SimpleQuadVectorEnv(2, readings=True, autoreset_mode="DISABLED") for _ in range(2))
    twin = SimpleQuadVectorEnv(2, readings=True, autoreset_mode="DISABLED")
    rng = np.random.default_rng(2)
    for env in (used, twin):
        env.reset(seed=[4, 5])
    for _ in range(15):
        action = HOME + rng.uniform(-0.3, 0.3, (2, 12)).astype(np.float32)
        for env in (used, twin):
            env.step(action)
    used.reset(seed=[4, 5], options={"reset_mask": np.array([True, False])})
    fresh.reset(seed=[4, 5])
    action = HOME + rng.uniform(-0.3, 0.3, (2, 12)).astype(np.float32)
    found, first, later = (env.step(action)[-1] for env in (used, fresh, twin))
    for name in MEASURED:
        np.testing.assert_array_equal(found[name][0], first[name][0], err_msg=name)
        np.testing.assert_array_equal(found[name][1], later[name][1], err_msg=name)
    assert (found["torque_change"][1] != first["torque_change"][1]).any()


def test_the_force_on_a_foot_is_the_sum_of_its_sensors_in_their_order() -> None:
    rng = np.random.default_rng(4)
    sensors = rng.uniform(0.0, 80.0, size=(5, 3, 1))
    touch = [[sensors[0]], [sensors[1], sensors[2]], [sensors[3]], [sensors[4]]]
    for env_ids in (slice(None), np.array([2, 0])):
        force = sum_foot_forces(touch, env_ids)
        expected = np.hstack((sensors[0], sensors[1] + sensors[2], sensors[3], sensors[4]))[env_ids]
        assert force.tobytes() == expected.tobytes()
    sensors[:] = 0.0
    assert force.all(), "the result is a view of the sensors"
