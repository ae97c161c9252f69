"""Faults in training, validation and searches: what episodes, ground and settings really reach the robots and PPO."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import policies
from evaluate.rollouts.hardware import IDEAL
from quad_env.physics.randomisation import RandomisedModels
from quad_env.scenarios.named import SCENARIOS, scenario
from quad_env.scenarios.randomisation import DomainRandomisation
from quad_env.scenarios.terrain import SmoothRandom
from quad_env.seeding import PURPOSES, EpisodeStreams, episode_seeds
from quad_env.sensing import observation as sensed
from quad_env.sensing.observation import Sensors
from quad_env.task.observations import OBSERVATION
from tests.batches import Batch, begun
from tests.planted_faults.harness import Faults, Plant, checks_of, fault_tests
from train import training_robots, validation
from train.config import PUSHES, PpoConfig, TrainConfig, ValidationConfig
from train.run import make_env
from train.search import trot
from train.search.cmaes import Effort, Subject, evolve

JUDGED = ValidationConfig(episodes=1, scenarios=("flat", "push", "rough"))
SMALL = TrainConfig(
    threads=1,
    seed=7,
    curriculum=1.0,
    mixture=(("flat", 0.5), ("push", 1 / 6), ("rough", 1 / 3)),
    ppo=PpoConfig(envs=6, rollout_steps=2, minibatch=6, epochs=1),
)


BRIEF = 120
"""Control steps of an episode, just longer than the second that measures leave out."""


EXAM_SURFACE = SCENARIOS["rough"].terrain.seed  # type: ignore[union-attr]


def families(found: list[Batch]) -> set[str]:
    """Purposes that the seeds belong to."""
    assert found
    return {PURPOSES[seed >> 48] for batch in found for seed in batch.seeds}


def surfaces(found: list[Batch]) -> set[int]:
    """Seeds of the random ground that was walked on."""
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

    effort = Effort(generations=2, candidates=4, episodes=3, steps=BRIEF, spread=0.1)
    ranges = {"frequency": (2.0, 4.0), "duty": (0.4, 0.6)}
    unused: dict[str, Any] = {"conclude": lambda _: ("", ""), "file": Path("unused.json"), "account": "unused.md"}
    list(evolve(effort, Subject(trot.TrotParameters(), ranges, costs, **unused)))
    assert {PURPOSES[seed >> 48] for seed in seen} == {"search"}
    assert len(set(seen)) == 6, "every generation has new episodes"


def check_training_robots_have_their_own_episodes_ground_and_pushes() -> None:
    with begun() as starts:
        env = make_env(SMALL)
        env.reset()
        env.close()
    assert families(starts) == {"training"}
    assert EXAM_SURFACE not in surfaces(starts)
    by_axis = {start.env.scenario.axis: start for start in starts}
    assert {axis: len(start.seeds) for axis, start in by_axis.items()} == {"flat": 3, "push": 1, "rough": 2}
    assert by_axis["push"].env.scenario.pushes == replace(SCENARIOS["push"].pushes, count=PUSHES)  # type: ignore[type-var]
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
    """Each has mass, friction and servos of its own, other ones in its next episode, and offset encoders."""
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


def figures(robots: Any, row: int) -> dict[str, float]:
    """Of a robot's own model: what it would move by."""
    robots.simulation.show_load(row)
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
    """What the joint angles that each robot observes are off, (n, 12), rad."""
    shown = robots._observation[:, OBSERVATION["joint_position"]] + robots.robot.home_pose
    return np.asarray(shown - robots.simulation.qpos[:, 7:])


def drawn_once(patch: pytest.MonkeyPatch) -> None:
    """Every robot and every episode has the same figures."""
    true_draw, first = DomainRandomisation.draw, EpisodeStreams(0, 0).randomisation
    drawn = true_draw(DomainRandomisation(), 12, first)
    patch.setattr(DomainRandomisation, "draw", lambda *_: drawn)


def without_randomisation(original: Any) -> Any:
    return lambda *args, **kwargs: replace(original(*args, **kwargs), randomisation=None)


def without_profile(original: Any) -> Any:
    return lambda *args, **kwargs: replace(original(*args, **kwargs), hardware=False)


def seeds_of_evaluation(module: str) -> Plant:
    """The module draws its episodes from the evaluation's family."""
    return lambda patch: patch.setattr(
        f"{module}.episode_seeds", lambda _, seed, count: episode_seeds("evaluation", seed, count)
    )


def ground_of_evaluation(module: str) -> Plant:
    """The module has the evaluation's own surface."""
    return lambda patch: patch.setattr(f"{module}.practice", lambda name, *_, **__: scenario(name))


def number_of_pushes_forgotten(patch: pytest.MonkeyPatch) -> None:
    patch.setattr("train.training_robots._pushed", lambda original: original)


FAULTS: Faults = {
    "best checkpoint on evaluation seeds": (
        seeds_of_evaluation("train.validation"),
        check_validation_is_on_its_own_episodes_and_ground,
    ),
    "validation on evaluation ground": (
        ground_of_evaluation("train.validation"),
        check_validation_is_on_its_own_episodes_and_ground,
    ),
    "profile not passed to validation": (
        lambda patch: patch.setattr(validation, "practice", without_profile(validation.practice)),
        check_validation_and_training_have_the_hardware_profile,
    ),
    "profile lost where a scenario is eased": (
        lambda patch: patch.setattr(training_robots, "eased", without_profile(training_robots.eased)),
        check_validation_and_training_have_the_hardware_profile,
    ),
    "randomisation lost where a scenario is eased": (
        lambda patch: patch.setattr(training_robots, "eased", without_randomisation(training_robots.eased)),
        check_training_robots_are_randomised,
    ),
    "randomisation that never reaches the models": (
        lambda patch: patch.setattr(RandomisedModels, "begin", lambda *_: None),
        check_training_robots_are_randomised,
    ),
    "randomisation drawn once for all": (drawn_once, check_training_robots_are_randomised),
    "encoders without offsets": (
        lambda patch: patch.setattr(sensed, "Sensors", lambda *args: Sensors(*args[:4], False)),
        check_training_robots_are_randomised,
    ),
    "searches on evaluation seeds": (
        seeds_of_evaluation("train.search.cmaes"),
        check_searches_are_on_their_own_episodes_and_ground,
    ),
    "search of the trot on evaluation ground": (
        ground_of_evaluation("train.search.trials"),
        check_searches_are_on_their_own_episodes_and_ground,
    ),
    "training on evaluation seeds": (
        seeds_of_evaluation("train.training_robots"),
        check_training_robots_have_their_own_episodes_ground_and_pushes,
    ),
    "training on evaluation ground": (
        ground_of_evaluation("train.training_robots"),
        check_training_robots_have_their_own_episodes_ground_and_pushes,
    ),
    "training with the pushes of an evaluation": (
        number_of_pushes_forgotten,
        check_training_robots_have_their_own_episodes_ground_and_pushes,
    ),
}


test_the_code_passes, test_the_fault_turns_its_check_red, test_every_check_has_a_fault = fault_tests(
    checks_of(globals()), FAULTS
)
