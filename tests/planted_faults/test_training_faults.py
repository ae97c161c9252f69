"""Faults in training, validation and searches: what episodes, ground and settings really reach the robots and PPO."""

import contextlib
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import policies
from evaluate.rollouts.hardware import IDEAL
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.scenarios.named import SCENARIOS, scenario
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import SmoothRandom
from quad_env.seeding import PURPOSES, episode_seeds
from tests.planted_faults.harness import Faults, Plant, checks_of, fault_tests
from train import validation
from train.config import PUSHES, PpoConfig, TrainConfig, ValidationConfig
from train.run import make_env, train
from train.sb3.ppo import build
from train.search import feedback, trot
from train.search import subject as searches
from train.search.command import evolve
from train.search.subject import Effort, unit_cube

SETTINGS = PpoConfig(
    envs=6,
    rollout_steps=2,
    minibatch=6,
    epochs=3,
    gamma=0.91,
    gae_lambda=0.83,
    entropy=0.013,
    learning_rate=3e-4,
    learning_rate_schedule="constant",
    log_std_init=-1.3,
    actor=(5, 4),
    critic=(3,),
)
JUDGED = ValidationConfig(episodes=1, scenarios=("flat", "push", "rough"))
SMALL = TrainConfig(
    threads=1,
    seed=7,
    curriculum=1.0,
    mixture=(("flat", 0.5), ("push", 1 / 6), ("rough", 1 / 3)),
    ppo=SETTINGS,
)


BRIEF = 120
"""Control steps of an episode, just longer than the second that measures leave out."""


@dataclass(frozen=True)
class Start:
    """Episodes that a batch began."""

    scenario: Scenario
    seeds: tuple[int, ...]
    hardware: tuple[bool, bool]
    """Whether the motors become warm, and whether what the sensors read is in the infos."""


@contextlib.contextmanager
def recorded() -> Iterator[list[Start]]:
    """Every batch that is reset with seeds while this lasts, with the scenario it simulates."""
    found: list[Start] = []
    true_reset = SimpleQuadVectorEnv.reset

    def reset(self: SimpleQuadVectorEnv, *, seed: Any = None, options: Any = None) -> Any:
        observation, infos = true_reset(self, seed=seed, options=options)
        if seed is not None:
            hardware = self.simulation.winding_temperature is not None, "sensor_gyro" in infos
            found.append(Start(self.scenario, tuple(int(each) for each in np.atleast_1d(seed)), hardware))
        return observation, infos

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SimpleQuadVectorEnv, "reset", reset)
        yield found


def families(starts: list[Start]) -> set[str]:
    """Purposes that the seeds belong to: the bits above the 48th."""
    assert starts
    return {PURPOSES[seed >> 48] for start in starts for seed in start.seeds}


def surfaces(starts: list[Start]) -> set[int]:
    """Seeds of the random ground that was walked on."""
    found = {start.scenario.terrain.seed for start in starts if isinstance(start.scenario.terrain, SmoothRandom)}
    assert found
    return found


EXAM_SURFACE = SCENARIOS["rough"].terrain.seed  # type: ignore[union-attr]


def check_validation_is_on_its_own_episodes_and_ground() -> None:
    with recorded() as starts, pytest.MonkeyPatch.context() as patch:
        patch.setattr(validation, "run", partial(validation.run, steps=BRIEF))
        found = validation.validate(policies.make("stand"), JUDGED, 1, IDEAL)
    assert families(starts) == {"validation"}
    assert EXAM_SURFACE not in surfaces(starts)
    assert list(found) == ["flat", "push", "rough"] == [start.scenario.axis for start in starts]


def check_searches_are_on_their_own_episodes_and_ground() -> None:
    with recorded() as starts:
        trot.candidate_costs([trot.TrotParameters()], episode_seeds("search", 0, 1), BRIEF, 1)
        exercises = ("flat=1.5", "rough=0.12")
        feedback.candidate_costs([policies.make("trot")], exercises, episode_seeds("search", 0, 1), BRIEF, 1)
    assert EXAM_SURFACE not in surfaces(starts)
    seen: list[int] = []

    def costs(candidates: list[Any], seeds: np.ndarray) -> list[float]:
        seen.extend(seeds.tolist())
        return [float(place) for place, _ in enumerate(candidates)]

    effort = Effort(generations=2, candidates=4, episodes=3, steps=BRIEF, spread=0.1)
    ranges = {"frequency": (2.0, 4.0), "duty": (0.4, 0.6)}
    space = unit_cube(trot.TrotParameters(), ranges, costs, searches.generations(0, effort))
    list(evolve(0, effort, space))
    assert {PURPOSES[seed >> 48] for seed in seen} == {"search"}
    assert len(set(seen)) == 6, "every generation has new episodes"


def check_training_robots_have_their_own_episodes_ground_and_pushes() -> None:
    with recorded() as starts:
        env = make_env(SMALL)
        env.reset()
        env.close()
    assert families(starts) == {"training"}
    assert EXAM_SURFACE not in surfaces(starts)
    by_axis = {start.scenario.axis: start for start in starts}
    assert {axis: len(start.seeds) for axis, start in by_axis.items()} == {"flat": 3, "push": 1, "rough": 2}
    assert by_axis["push"].scenario.pushes == replace(SCENARIOS["push"].pushes, count=PUSHES)  # type: ignore[type-var]
    seeds = [seed for start in by_axis.values() for seed in start.seeds]
    assert len(set(seeds)) == 6


def check_robots_of_training_and_validation_have_the_hardware_of_the_run() -> None:
    """A whole run with a validation, on motors that become warm and sensors that are read."""
    judged = ValidationConfig(episodes=1, scenarios=("flat",))
    for actuator, sensors in (("motor", "truth"), ("ideal", "typical")):
        with recorded() as starts, pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory() as folder:
            patch.setattr(validation, "run", partial(validation.run, steps=BRIEF))
            run = replace(SMALL, actuator=actuator, sensors=sensors, steps=12, validation=judged, out=Path(folder))
            train(run)
        assert families(starts) == {"training", "validation"}
        assert {start.hardware for start in starts} == {(actuator == "motor", sensors == "typical")}


def check_every_setting_of_the_learner_reaches_it() -> None:
    env = make_env(SMALL)
    model = build(SMALL, env)
    env.close()
    taken = {
        "rollout_steps": model.n_steps,
        "minibatch": model.batch_size,
        "epochs": model.n_epochs,
        "gamma": model.gamma,
        "gae_lambda": model.gae_lambda,
        "entropy": model.ent_coef,
        "learning_rate": model.lr_schedule(0.5),
        "envs": model.n_envs,
    }
    assert taken == {name: getattr(SETTINGS, name) for name in taken}
    buffer = model.rollout_buffer
    assert (buffer.gamma, buffer.gae_lambda) == (0.91, 0.83)
    assert (model.clip_range(1.0), model.vf_coef, model.max_grad_norm) == (0.2, 0.5, 1.0)
    widths = [[layer.out_features for layer in net if hasattr(layer, "out_features")] for net in _nets(model)]
    assert widths == [[5, 4], [3]]
    assert {type(layer).__name__ for net in _nets(model) for layer in net} == {"FirstOf", "Linear", "ELU"}
    np.testing.assert_allclose(model.policy.log_std.detach().numpy(), -1.3, rtol=1e-6)


def _nets(model: Any) -> list[Any]:
    return [model.policy.mlp_extractor.policy_net, model.policy.mlp_extractor.value_net]


def check_the_validation_score_counts_both_errors_of_every_scenario() -> None:
    found = {
        "flat": {"velocity_error": 0.1, "yaw_rate_error": 0.4, "fall_rate": 0.0},
        "rough": {"velocity_error": 0.3, "yaw_rate_error": 0.8, "fall_rate": 0.5},
    }
    assert validation.score(found) == pytest.approx((0.1 + 0.5 * 0.4 + 0.3 + 0.5 * 0.8) / 2)


def seeds_of_evaluation(module: str) -> Plant:
    """The module draws its episodes from the evaluation's family."""
    return lambda patch: patch.setattr(
        f"{module}.episode_seeds", lambda _, seed, count: episode_seeds("evaluation", seed, count)
    )


def ground_of_evaluation(module: str) -> Plant:
    """The module has the evaluation's own surface."""
    return lambda patch: patch.setattr(f"{module}.practice", lambda name, *_, **__: scenario(name))


def ppo_with(change: Callable[[dict[str, Any]], dict[str, Any]]) -> Plant:
    """PPO is made with other arguments than it was called with."""

    def plant(patch: pytest.MonkeyPatch) -> None:
        from train.sb3 import ppo

        true_ppo = ppo.PPO
        patch.setattr(ppo, "PPO", lambda *args, **kwargs: true_ppo(*args, **change(kwargs)))

    return plant


def without(name: str) -> Callable[[dict[str, Any]], dict[str, Any]]:
    return lambda arguments: {key: value for key, value in arguments.items() if key != name}


def gamma_and_lambda_swapped(arguments: dict[str, Any]) -> dict[str, Any]:
    return arguments | {"gamma": arguments["gae_lambda"], "gae_lambda": arguments["gamma"]}


def one_scenario_for_all_robots(patch: pytest.MonkeyPatch) -> None:
    patch.setattr("train.training_robots.robots_per_scenario", lambda config: {"rough": config.ppo.envs})


def number_of_pushes_forgotten(patch: pytest.MonkeyPatch) -> None:
    patch.setattr("train.training_robots._pushed", lambda original: original)


def training_without(part: str) -> Plant:
    """The robots of a run have what is usual of the motors or sensors."""

    def plant(patch: pytest.MonkeyPatch) -> None:
        true_batch = SimpleQuadVectorEnv

        def batch(*args: Any, **kwargs: Any) -> SimpleQuadVectorEnv:
            return true_batch(*args, **without(part)(kwargs))

        patch.setattr("train.training_robots.SimpleQuadVectorEnv", batch)

    return plant


def validation_on_ideal_robots(patch: pytest.MonkeyPatch) -> None:
    true_validate = validation.validate
    patch.setattr(
        "train.sb3.callbacks.validate",
        lambda policy, config, nthread, _: true_validate(policy, config, nthread, IDEAL),
    )


def validation_on_flat_ground_alone(patch: pytest.MonkeyPatch) -> None:
    true_validate = validation.validate
    patch.setattr(
        validation,
        "validate",
        lambda policy, config, *rest: true_validate(policy, replace(config, scenarios=("flat",)), *rest),
    )


def the_same_episodes_in_every_generation(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(
        searches, "episode_seeds", lambda purpose, seed, count: np.resize(episode_seeds(purpose, seed, 3), count)
    )


FAULTS: Faults = {
    "best checkpoint on evaluation seeds": (
        seeds_of_evaluation("train.validation"),
        check_validation_is_on_its_own_episodes_and_ground,
    ),
    "validation on evaluation ground": (
        ground_of_evaluation("train.validation"),
        check_validation_is_on_its_own_episodes_and_ground,
    ),
    "validation on flat ground alone": (
        validation_on_flat_ground_alone,
        check_validation_is_on_its_own_episodes_and_ground,
    ),
    "searches on evaluation seeds": (
        seeds_of_evaluation("train.search.subject"),
        check_searches_are_on_their_own_episodes_and_ground,
    ),
    "search of the trot on evaluation ground": (
        ground_of_evaluation("train.search.trot"),
        check_searches_are_on_their_own_episodes_and_ground,
    ),
    "search of the feedback on evaluation ground": (
        ground_of_evaluation("train.search.feedback"),
        check_searches_are_on_their_own_episodes_and_ground,
    ),
    "searches on the same episodes in every generation": (
        the_same_episodes_in_every_generation,
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
    "training with the mixture ignored": (
        one_scenario_for_all_robots,
        check_training_robots_have_their_own_episodes_ground_and_pushes,
    ),
    "training with the pushes of an evaluation": (
        number_of_pushes_forgotten,
        check_training_robots_have_their_own_episodes_ground_and_pushes,
    ),
    "training without its motors": (
        training_without("actuator"),
        check_robots_of_training_and_validation_have_the_hardware_of_the_run,
    ),
    "training without its sensors": (
        training_without("sensors"),
        check_robots_of_training_and_validation_have_the_hardware_of_the_run,
    ),
    "validation on ideal robots": (
        validation_on_ideal_robots,
        check_robots_of_training_and_validation_have_the_hardware_of_the_run,
    ),
    "gamma and lambda swapped": (ppo_with(gamma_and_lambda_swapped), check_every_setting_of_the_learner_reaches_it),
    "gradient norm never passed to PPO": (
        ppo_with(without("max_grad_norm")),
        check_every_setting_of_the_learner_reaches_it,
    ),
    "yaw dropped from the validation score": (
        lambda patch: patch.setattr(validation, "YAW_WEIGHT", 0.0),
        check_the_validation_score_counts_both_errors_of_every_scenario,
    ),
}


test_the_code_passes, test_the_fault_turns_its_check_red, test_every_check_has_a_fault = fault_tests(
    checks_of(globals()), FAULTS
)
