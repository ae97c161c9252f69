"""Domain randomisation: robots, times and consequences of changes.

`tests/quad_env/envs/test_every_field.py` tests the effect of each field, and `test_state.py` that robots move by the
models shown.
"""

import copy
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

import quad_env
from quad_env import OBSERVATION, SIMPLE_QUAD, DomainRandomisation, Scenario, scenario
from quad_env.actuation.models import ACTUATORS, Thermal
from quad_env.envs.env import SimpleQuadEnv
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.physics import simulators
from quad_env.physics.model import compile_model
from quad_env.physics.simulators import check_simulator
from quad_env.scenarios.episode import EpisodeSample
from quad_env.seeding import EpisodeStreams

SEEDS = (3, 4, 5)
FIELDS = "body_mass", "body_inertia", "body_ipos", "geom_friction", "actuator_gainprm", "actuator_biasprm"
FIELDS += ("actuator_forcerange", "dof_invweight0", "bvh_aabb")


@contextmanager
def robots(name: str = "flat+randomised", **options: Any) -> Iterator[SimpleQuadVectorEnv]:
    """Return robots of some seeds in their first episodes."""
    env = SimpleQuadVectorEnv(len(SEEDS), name, **options)
    env.reset(seed=SEEDS)
    yield env
    env.close()


def figures(env: Any, row: int = 0) -> dict[str, np.ndarray]:
    """Return the model parameters of a robot, of its geoms only those that collide."""
    env.simulation.sync_model(row)
    model = env.simulation.model
    values = {field: getattr(model, field).copy() for field in FIELDS}
    values["geom_friction"] = values["geom_friction"][(model.geom_contype | model.geom_conaffinity) != 0]
    return values


def differing(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> set[str]:
    return {field for field in FIELDS if not np.array_equal(one[field], other[field])}


def test_every_robot_has_figures_of_its_own_which_its_next_episode_draws_anew() -> None:
    with robots() as env:
        before = [figures(env, row) for row in range(3)]
        assert differing(before[0], before[1]) == set(FIELDS)
        env.reset(options={"reset_mask": np.array([False, True, False])})
        after = [figures(env, row) for row in range(3)]
        assert [differing(*each) for each in zip(before, after, strict=True)] == [set(), set(FIELDS), set()]
        env.reset(seed=SEEDS)
        assert not differing(figures(env, 1), before[1]), "of the usual figures, not of the last episode's"


def test_a_robot_alone_has_the_figures_of_its_row() -> None:
    alone = SimpleQuadEnv("flat+randomised")
    alone.reset(seed=SEEDS[2])
    with robots() as env:
        # The bounding boxes of the single environment contain its visual geoms, which a batch does not have.
        assert differing(figures(alone), figures(env, 2)) <= {"bvh_aabb"}


def test_constants_follow_from_mass_and_centre_of_mass() -> None:
    with robots("payload=20+randomised") as env:
        figures(env, 1)
        shown = env.simulation.model
    worked_out = copy.copy(shown)
    worked_out.qpos0[2] = worked_out.key("home").qpos[2]
    mujoco.mj_setConst(worked_out, mujoco.MjData(worked_out))
    for field in ("dof_invweight0", "body_subtreemass", "bvh_aabb", "body_sameframe"):
        np.testing.assert_allclose(getattr(shown, field), getattr(worked_out, field), err_msg=field)
    trunk, payload = shown.body("base_link"), shown.body("payload")
    assert trunk.mass != 5.0
    assert trunk.ipos.all()
    assert payload.mass == 20.0
    assert not payload.ipos.any()


def test_nothing_else_is_drawn_otherwise() -> None:
    plain, randomised = (
        EpisodeSample(SIMPLE_QUAD, scenario(name), 3, 0, 0.01) for name in ("surprise", "surprise+randomised")
    )
    for drawn in ("start", "force", "payload_position", "dropouts"):
        np.testing.assert_array_equal(getattr(plain, drawn), getattr(randomised, drawn))
    np.testing.assert_array_equal(plain.pushes.force, randomised.pushes.force)
    np.testing.assert_array_equal(plain.next_command(), randomised.next_command())


def test_a_figure_is_drawn_alike_whatever_else_is_randomised() -> None:
    every, one = DomainRandomisation(), DomainRandomisation((1.0, 1.0), 0.0, (0.0, 0.0, 0.0), 0.0, 0.0, 0.0, 0.0)
    drawn, alone = (each.draw(12, EpisodeStreams(3, 0).randomisation) for each in (every, one))
    np.testing.assert_array_equal(drawn.encoder_offset, alone.encoder_offset)
    assert (alone.friction, alone.trunk_mass, alone.delay) == (1.0, 1.0, 0.0)
    assert (alone.stiffness == 1.0).all()
    assert not alone.centre_of_mass.any()


def test_delays_of_the_scenario_and_of_the_draw_add_up() -> None:
    late = replace(scenario("latency=0.03"), randomisation=DomainRandomisation(delay=0.05))
    delays = [EpisodeSample(SIMPLE_QUAD, late, seed, 0, 0.01).action_delay for seed in range(60)]
    assert set(delays) == {3, 4, 5, 6, 7, 8}
    with robots(late) as env:
        targets = SIMPLE_QUAD.home_pose + 0.01 * np.arange(1, 12)[:, None, None] * np.ones((3, 12))
        received = np.array([env.step(each) and env.simulation.batch.bind("ctrl")[:, 0].copy() for each in targets])
        for row, seed in enumerate(SEEDS):
            assert (
                np.count_nonzero(received[:, row] < 0.005)
                == EpisodeSample(SIMPLE_QUAD, late, seed, 0, 0.01).action_delay
            )


def test_figures_stay_within_their_ranges_and_fill_them() -> None:
    drawn = [DomainRandomisation().draw(12, EpisodeStreams(seed, 0).randomisation) for seed in range(400)]
    for field, low, high in (("friction", 0.5, 1.25), ("trunk_mass", 0.8, 1.2), ("delay", 0.0, 0.02)):
        found = np.array([getattr(each, field) for each in drawn])
        assert low <= found.min() < low + 0.02 * (high - low)
        assert high - 0.02 * (high - low) < found.max() <= high


def test_warm_motors_are_derated_from_the_torque_of_their_own_strength() -> None:
    """The derating ends in the shutdown; a new episode starts with the robot's full torque."""
    hot = replace(ACTUATORS["motor"], thermal=Thermal(4.0, 0.05))
    with robots(actuator=hot, terminate_on_fall=False) as env:
        strength = EpisodeSample(SIMPLE_QUAD, env.scenario, SEEDS[1], 0, 0.01).randomised.motor_strength
        np.testing.assert_allclose(figures(env, 1)["actuator_forcerange"][:, 1], 100.0 * strength)
        for _ in range(30):
            env.step(np.tile(SIMPLE_QUAD.joint_upper, (3, 1)))
        limits = figures(env, 1)["actuator_forcerange"][:, 1]
        assert (limits == 0.0).any(), "switched off"
        env.reset(seed=SEEDS)
        np.testing.assert_allclose(figures(env, 1)["actuator_forcerange"][:, 1], 100.0 * strength)


@pytest.mark.parametrize("options", [{}, {"sensors": "ideal"}], ids=["truth", "sensors"])
def test_observations_have_the_offset_of_the_encoders_once(options: dict[str, Any]) -> None:
    calm = Scenario("calm", start=quad_env.StartNoise(0, 0, 0, 0, 0, 0), randomisation=DomainRandomisation())
    env = SimpleQuadVectorEnv(2, replace(calm, noise=quad_env.SensorNoise(0.0)), **options)
    seen, infos = env.reset(seed=3)
    offset = EpisodeSample(SIMPLE_QUAD, env.scenario, 4, 0, 0.01).randomised.encoder_offset
    np.testing.assert_allclose(seen[1, OBSERVATION["joint_position"]], offset, atol=1e-6)
    if options:
        np.testing.assert_allclose(infos["sensor_joint_position"][1], SIMPLE_QUAD.home_pose + offset)


def test_the_hardware_profile_goes_with_it() -> None:
    found = scenario("push=55+randomised+hardware")
    with robots(found) as env:
        assert env.scenario.hardware
        assert env.simulation.winding_temperature is not None
        stiffness = figures(env, 0)["actuator_gainprm"][:, 4]
        assert np.ptp(stiffness / env.robot.servo_stiffness) > 0.1


def test_servo_gains_of_each_robot_are_randomised_about_its_own() -> None:
    servo = np.array([100.0, 200.0, 300.0])[:, None] * np.ones(12), np.full((3, 12), 5.0)
    with robots(servo=servo) as env:
        for row, seed in enumerate(SEEDS):
            drawn = EpisodeSample(SIMPLE_QUAD, env.scenario, seed, 0, 0.01).randomised
            own = figures(env, row)
            np.testing.assert_allclose(own["actuator_gainprm"][:, 0], 100.0 * (row + 1) * drawn.stiffness)
            np.testing.assert_allclose(
                own["actuator_biasprm"][:, 1:3].T, -np.stack((own["actuator_gainprm"][:, 0], 5.0 * drawn.damping))
            )


def test_drake_refuses_it_in_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulators, "find_spec", lambda _: object())
    with pytest.raises(
        ValueError, match=r"not support the domain randomisation of 'flat\+randomised'; it supports"
    ) as error:
        check_simulator("drake", scenario("flat+randomised"), ACTUATORS["ideal"])
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"friction": (1.2, 0.8)}, "range of friction must rise"),
        ({"trunk_mass": 1.0}, "trunk_mass must be from 0 to 0.9"),
        ({"delay": -0.01}, "delay must be from 0 s"),
    ],
)
def test_what_is_no_range_is_refused(settings: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        DomainRandomisation(**settings)


def test_every_figure_of_a_robot_is_the_usual_one_times_its_own_factor() -> None:
    """Motors have equal limits in both directions.

    The second of two robots is reset, and the first keeps its parameters.
    """
    scenario = replace(quad_env.SCENARIOS["flat"], randomisation=DomainRandomisation())
    env = SimpleQuadVectorEnv(2, scenario, autoreset_mode="DISABLED")
    usual = compile_model(SIMPLE_QUAD, replace(scenario, randomisation=None))
    trunk = usual.body("base_link").id
    for seeds, mask in (([3, 4], [True, True]), ([8, 9], [False, True])):
        env.reset(seed=seeds, options={"reset_mask": np.array(mask)})
        for robot, seed in enumerate((3, seeds[1])):
            drawn = EpisodeSample(SIMPLE_QUAD, scenario, seed, 0, env.dt).randomised
            assert drawn is not None
            env.simulation.sync_model(robot)
            model = env.simulation.model
            strength = usual.actuator_forcerange * drawn.motor_strength[:, None]
            np.testing.assert_allclose(model.actuator_forcerange, strength)
            np.testing.assert_allclose(model.actuator_gainprm[:, 0], usual.actuator_gainprm[:, 0] * drawn.stiffness)
            np.testing.assert_allclose(model.actuator_biasprm[:, 1], usual.actuator_biasprm[:, 1] * drawn.stiffness)
            np.testing.assert_allclose(model.actuator_biasprm[:, 2], usual.actuator_biasprm[:, 2] * drawn.damping)
            np.testing.assert_allclose(model.body_mass[trunk], usual.body_mass[trunk] * drawn.trunk_mass)
            np.testing.assert_allclose(model.body_inertia[trunk], usual.body_inertia[trunk] * drawn.trunk_mass)
            np.testing.assert_allclose(model.body_ipos[trunk], usual.body_ipos[trunk] + drawn.centre_of_mass)
            ground = slice(usual.body_geomnum[0])
            np.testing.assert_allclose(model.geom_friction[ground, 0], usual.geom_friction[ground, 0] * drawn.friction)
