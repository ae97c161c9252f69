"""Faults in training, validation and searches: episodes, terrain and settings that reach the robots and PPO."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import policies
from evaluate.hardware import IDEAL
from policies.residual import Features
from quad_env.physics.randomisation import RandomisedModels
from quad_env.scenarios.randomisation import DomainRandomisation
from quad_env.scenarios.registry import SCENARIOS, scenario
from quad_env.scenarios.terrain import SmoothRandom
from quad_env.seeding import PURPOSES, EpisodeStreams, episode_seeds
from quad_env.sensing import observation as sensed
from quad_env.sensing.height_scan import HeightScan
from quad_env.sensing.observation import ObservationDisturbance
from quad_env.task.observations import OBSERVATION, OBSERVATION_SIZE
from tests.batches import Batch, begun
from tests.planted_faults.harness import Faults, Plant, checks_of, fault_tests
from train import training_robots, validation
from train.config import PpoConfig, TrainConfig, ValidationConfig
from train.run import make_env
from train.search import cmaes, trials, trot
from train.search.cmaes import SearchOptions, SearchProblem, evolve

JUDGED = ValidationConfig(episodes=1, scenarios=("flat", "push", "rough"))
SMALL = TrainConfig(
    threads=1,
    seed=7,
    curriculum=1.0,
    mixture=(("flat", 0.5), ("push", 1 / 6), ("rough", 1 / 3)),
    ppo=PpoConfig(envs=6, rollout_steps=2, minibatch=6, epochs=1),
)


SCAN = HeightScan(ahead=1, behind=0, aside=0, spacing=0.3)
SCALE = SCAN.term.scale


BRIEF = 120
"""Number of control steps of an episode, just longer than the second that the measures leave out."""


EXAM_SURFACE = SCENARIOS["rough"].terrain.seed  # type: ignore[union-attr]


def families(found: list[Batch]) -> set[str]:
    """Return the purposes of the seeds."""
    assert found
    return {PURPOSES[seed >> 48] for batch in found for seed in batch.seeds}


def surfaces(found: list[Batch]) -> set[int]:
    """Return the seeds of the random terrain of the batches."""
    grounds = [batch.env.scenario.terrain for batch in found]
    seeds = {ground.seed for ground in grounds if isinstance(ground, SmoothRandom)}
    assert seeds
    return seeds


def check_validation_is_on_its_own_episodes_and_ground() -> None:
    with begun() as starts, pytest.MonkeyPatch.context() as patch:
        patch.setattr(validation, "run", partial(validation.run, steps=BRIEF))
        found = validation.validate(policies.make("stand"), JUDGED, 1, IDEAL)
    assert families(starts) == {"validation"}
    assert EXAM_SURFACE not in surfaces(starts)
    assert list(found) == ["flat", "push", "rough"] == [start.env.scenario.axis for start in starts]


def check_searches_are_on_their_own_episodes_and_ground() -> None:
    with begun() as starts:
        trot.candidate_costs([trot.TrotParameters()], episode_seeds("search", 0, 1), BRIEF, 1)
    assert EXAM_SURFACE not in surfaces(starts)
    seen: list[int] = []

    def costs(candidates: list[Any], seeds: np.ndarray) -> list[float]:
        seen.extend(seeds.tolist())
        return [float(place) for place, _ in enumerate(candidates)]

    effort = SearchOptions(generations=2, candidates=4, episodes=3, steps=BRIEF, spread=0.1)
    ranges = {"frequency": (2.0, 4.0), "duty": (0.4, 0.6)}
    unused: dict[str, Any] = {"finalize": lambda _: ("", ""), "file": Path("unused.json"), "account": "unused.md"}
    list(evolve(effort, SearchProblem(trot.TrotParameters(), ranges, costs, **unused)))
    assert {PURPOSES[seed >> 48] for seed in seen} == {"search"}
    assert len(set(seen)) == 6, "every generation has new episodes"


def check_training_robots_have_their_own_episodes_and_ground() -> None:
    with begun() as starts:
        env = make_env(SMALL)
        env.reset()
        env.close()
    assert families(starts) == {"training"}
    assert EXAM_SURFACE not in surfaces(starts)
    by_axis = {start.env.scenario.axis: start for start in starts}
    assert {axis: len(start.seeds) for axis, start in by_axis.items()} == {"flat": 3, "push": 1, "rough": 2}
    seeds = [seed for start in by_axis.values() for seed in start.seeds]
    assert len(set(seeds)) == 6


def check_validation_and_training_have_the_hardware_profile() -> None:
    mixture = (("flat+hardware", 0.5), ("push+hardware", 0.5))
    config = replace(SMALL, curriculum=0.4, mixture=mixture, validation=ValidationConfig(episodes=1))
    with begun() as starts, pytest.MonkeyPatch.context() as patch:
        patch.setattr(validation, "run", partial(validation.run, steps=BRIEF))
        validation.validate(policies.make("stand"), config.complete_validation, 1, config.hardware)
        env = make_env(config)
        env.reset()
        env.close()
    assert [start.purpose for start in starts] == ["validation", "validation", "training", "training"]
    assert [(start.sensed, start.warms) for start in starts] == [(True, True)] * 4
    assert starts[3].env.scenario.severity < starts[1].env.scenario.severity, "eased"


def check_training_robots_are_randomised() -> None:
    """Each robot has its own mass, friction and servos, new ones in its next episode, and encoders with offsets."""
    config = replace(SMALL, curriculum=0.4, mixture=(("flat+randomised", 0.5), ("rough=0.2+randomised", 0.5)))
    with begun() as starts:
        env = make_env(config)
        env.reset()
        env.close()
    assert [start.env.scenario.axis for start in starts] == ["flat", "rough"]
    for start in starts:
        robots = start.env
        before = [figures(robots, row) for row in range(3)]
        robots.reset()
        every = [*before, *(figures(robots, row) for row in range(3))]
        for figure in every[0]:
            assert len({each[figure] for each in every}) == 6, figure
        assert strayed(robots).std() > 0.005


def check_a_sighted_network_sees_the_ground_about_its_robot_now() -> None:
    mixture = (("rough=0.2", 0.5), ("rough=0.2+scan_lost", 0.5))
    config = replace(SMALL, curriculum=0.4, mixture=mixture, base="trot", sighted=True, scan=SCAN)
    env: Any = make_env(config).env
    seen, _ = env.reset(seed=1)
    for _ in range(30):
        shown, lost = (
            each.scenario.terrain.height(*points_about(each.simulation.qpos))
            - each.simulation.qpos[:, 2:3]
            + each.robot.home_height
            for each in env.env.batches
        )
        np.testing.assert_allclose(seen[:, OBSERVATION_SIZE : OBSERVATION_SIZE + 2][:3] / SCALE, shown, atol=1e-6)
        np.testing.assert_array_equal(seen[3:, OBSERVATION_SIZE : OBSERVATION_SIZE + 2], 0.0)
        seen = env.step(env.action_space.sample())[0]
    assert np.ptp(shown) > 0.02, "level ground shows no fault"
    assert np.abs(lost).max() > 0.02, "nor would a scan that is found again"
    env.close()


def points_about(qpos: np.ndarray) -> np.ndarray:
    """Return x and y of the points of SCAN around robots at given positions, (2, n, p), m."""
    w, x, y, z = qpos[:, 3:7].T
    heading = np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))
    ahead, left = SCAN.points.T
    turned = np.outer(np.cos(heading), ahead) - np.outer(np.sin(heading), left)
    aside = np.outer(np.sin(heading), ahead) + np.outer(np.cos(heading), left)
    return np.stack((qpos[:, 0:1] + turned, qpos[:, 1:2] + aside))


def a_step_ago(patch: pytest.MonkeyPatch) -> None:
    """Plant a fault: networks observe the height scan of the previous control step."""
    true_see, before = Features.update, {}

    def see(features: Features, observation: np.ndarray, base_action: np.ndarray) -> np.ndarray:
        late = observation.copy()
        late[:, OBSERVATION_SIZE:] = before.get(id(features), observation)[: len(late), OBSERVATION_SIZE:]
        before[id(features)] = observation
        return true_see(features, late, base_action)

    patch.setattr(Features, "update", see)


def scan_kept(patch: pytest.MonkeyPatch) -> None:
    """Plant a fault: a milder scenario loses its loss of the scan."""
    true_eased = training_robots.at_difficulty
    patch.setattr(training_robots, "at_difficulty", lambda *args: replace(true_eased(*args), scan_lost=False))


def figures(robots: Any, row: int) -> dict[str, float]:
    """Return the dynamics parameters of a robot's own model."""
    robots.simulation.sync_model(row)
    model = robots.simulation.model
    trunk = model.body("base_link")
    return {
        "mass": float(trunk.mass[0]),
        "centre of mass": float(trunk.ipos[0]),
        "friction": float(model.geom("ground").friction[0]),
        "stiffness": float(model.actuator_gainprm[0, 0]),
        "damping": float(model.actuator_biasprm[0, 2]),
        "strength": float(model.actuator_forcerange[0, 1]),
        "inverse weight": float(model.dof_invweight0[0]),
    }


def strayed(robots: Any) -> np.ndarray:
    """Return the error of the joint angles that each robot observes, (n, 12), rad."""
    shown = robots._observation[:, OBSERVATION["joint_position"]] + robots.robot.home_pose
    return np.asarray(shown - robots.simulation.qpos[:, 7:])


def drawn_once(patch: pytest.MonkeyPatch) -> None:
    """Plant a fault: every robot and every episode has the same parameters."""
    true_draw, first = DomainRandomisation.draw, EpisodeStreams(0, 0).randomisation
    drawn = true_draw(DomainRandomisation(), 12, first)
    patch.setattr(DomainRandomisation, "draw", lambda *_: drawn)


def without_randomisation(original: Any) -> Any:
    return lambda *args, **kwargs: replace(original(*args, **kwargs), randomisation=None)


def without_profile(original: Any) -> Any:
    return lambda *args, **kwargs: replace(original(*args, **kwargs), hardware=False)


def seeds_of_evaluation(module: ModuleType) -> Plant:
    """Let a module draw its episodes from the evaluation seeds."""
    return lambda patch: patch.setattr(
        module, "episode_seeds", lambda _, seed, count: episode_seeds("evaluation", seed, count)
    )


def ground_of_evaluation(module: ModuleType) -> Plant:
    """Let a module simulate on the terrain of the evaluation."""
    return lambda patch: patch.setattr(module, "with_terrain_seed", lambda name, *_, **__: scenario(name))


FAULTS: Faults = {
    "best checkpoint on evaluation seeds": (
        seeds_of_evaluation(validation),
        check_validation_is_on_its_own_episodes_and_ground,
    ),
    "validation on evaluation ground": (
        ground_of_evaluation(validation),
        check_validation_is_on_its_own_episodes_and_ground,
    ),
    "profile not passed to validation": (
        lambda patch: patch.setattr(validation, "with_terrain_seed", without_profile(validation.with_terrain_seed)),
        check_validation_and_training_have_the_hardware_profile,
    ),
    "profile lost where a scenario is eased": (
        lambda patch: patch.setattr(training_robots, "at_difficulty", without_profile(training_robots.at_difficulty)),
        check_validation_and_training_have_the_hardware_profile,
    ),
    "randomisation lost where a scenario is eased": (
        lambda patch: patch.setattr(
            training_robots, "at_difficulty", without_randomisation(training_robots.at_difficulty)
        ),
        check_training_robots_are_randomised,
    ),
    "randomisation that never reaches the models": (
        lambda patch: patch.setattr(RandomisedModels, "reset", lambda *_: None),
        check_training_robots_are_randomised,
    ),
    "height scan of the step before": (a_step_ago, check_a_sighted_network_sees_the_ground_about_its_robot_now),
    "a lost scan found again where a scenario is eased": (
        scan_kept,
        check_a_sighted_network_sees_the_ground_about_its_robot_now,
    ),
    "randomisation drawn once for all": (drawn_once, check_training_robots_are_randomised),
    "encoders without offsets": (
        lambda patch: patch.setattr(
            sensed, "ObservationDisturbance", lambda *args: ObservationDisturbance(*args[:4], False)
        ),
        check_training_robots_are_randomised,
    ),
    "searches on evaluation seeds": (
        seeds_of_evaluation(cmaes),
        check_searches_are_on_their_own_episodes_and_ground,
    ),
    "search of the trot on evaluation ground": (
        ground_of_evaluation(trials),
        check_searches_are_on_their_own_episodes_and_ground,
    ),
    "training on evaluation seeds": (
        seeds_of_evaluation(training_robots),
        check_training_robots_have_their_own_episodes_and_ground,
    ),
    "training on evaluation ground": (
        ground_of_evaluation(training_robots),
        check_training_robots_have_their_own_episodes_and_ground,
    ),
}


test_the_code_passes, test_the_fault_turns_its_check_red, test_every_check_has_a_fault = fault_tests(
    checks_of(globals()), FAULTS
)
