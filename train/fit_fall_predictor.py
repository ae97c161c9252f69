"""Fit of the fall predictor: `python -m train.fit_fall_predictor` writes policies/safety/prediction.json.

Logistic regression on episodes of the push axis, "falls within the next 0.4 s", then a threshold that an hour of
undisturbed walking stays below. All episodes are of the "search" family of seeds.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import policies
from evaluate import launcher
from evaluate.command_line import UsageError, fail, parse
from policies.base import CONTROL_PERIOD, Floats, Policy
from policies.files import write_atomically
from policies.safety.prediction import PREDICTOR_FILE, FallPredictor, features, next_reference
from quad_env.axes import AXES
from quad_env.scenarios import Scenario, scenario
from quad_env.seeding import episode_seeds

HORIZON = 0.4
"""A step is one before a fall if the fall comes within that time, s."""
SETTLING = 50
"""Control steps at the start of an episode that are not learned from."""
MARGIN = 0.5
"""Of log-odds between the threshold and the largest that undisturbed walking gave."""
ROUNDS, RIDGE = 30, 1e-3
"""Newton steps of the fit, and its penalty."""


@dataclass(frozen=True)
class Options:
    """Fit the fall predictor."""

    policies: tuple[str, ...] = ("trot",)
    """Names of the policies whose episodes are learned from."""
    episodes: int = 24
    """Episodes of each policy at each level of the push axis."""
    hours: float = 1.0
    """Undisturbed walking of each policy that the threshold is fitted to."""
    seed: int = 0
    """Of the episodes."""
    out: Path = PREDICTOR_FILE
    """JSON to write."""


def main(arguments: list[str] | None = None) -> int:
    """Fit and write; the exit code."""
    try:
        options = parse(Options, arguments, program="python -m train.fit_fall_predictor", description=__doc__ or "")
        if options.episodes < 1 or options.hours <= 0 or options.seed < 0:
            raise UsageError("--episodes must be at least 1, --hours positive, --seed not negative")
        predictor = fit(options)
        values = {"coefficients": predictor.coefficients, "threshold": predictor.threshold}
        write_atomically(options.out, (json.dumps(values, indent=2) + "\n").encode())
    except (UsageError, ValueError, OSError) as error:
        return fail(str(error))
    print(options.out)
    return 0


def fit(options: Options) -> FallPredictor:
    """The fitted predictor."""
    inputs, labels = [], []
    for name in options.policies:
        for level, severity in enumerate(AXES["push"].levels):
            seeds = episode_seeds("search", options.seed * 100 + level, options.episodes)
            seen, falling = _learned_from(policies.resolve(name), AXES["push"].scenario(severity, "push"), seeds)
            inputs.append(seen)
            labels.append(falling)
    coefficients = logistic(np.concatenate(inputs), np.concatenate(labels))
    unarmed = FallPredictor(tuple(float(c) for c in coefficients), 0.0)
    count = max(1, round(options.hours * 360))
    largest = max(
        undisturbed(policies.resolve(name), unarmed, episode_seeds("search", options.seed * 100 + 50, count))
        for name in options.policies
    )
    return FallPredictor(unarmed.coefficients, largest + MARGIN)


def steps_of(
    policy: Policy, where: Scenario, seeds: NDArray[np.int64], steps: int = 1000
) -> Iterator[tuple[NDArray[np.float32], NDArray[np.bool_]]]:
    """Observations (n, k) and which robots have fallen (n,), step by step; a fallen robot stays frozen."""
    from quad_env.vector_env import SimpleQuadVectorEnv

    env = SimpleQuadVectorEnv(len(seeds), where, nthread=1, autoreset_mode="DISABLED", max_episode_steps=steps)
    observation, _ = env.reset(seed=seeds.tolist())
    policy.reset(len(seeds), seed=0)
    for _ in range(steps):
        observation, _, terminated, _, _ = env.step(policy.act(observation))
        yield observation, terminated
        if terminated.all():
            break
    env.close()


def _learned_from(policy: Policy, where: Scenario, seeds: NDArray[np.int64]) -> tuple[Floats, NDArray[np.bool_]]:
    """Features (m, 8) of the steps of those episodes before a fall, and whether one follows within the horizon (m,)."""
    seen, fallen = [], []
    reference = np.zeros((len(seeds), 2))
    for observation, terminated in steps_of(policy, where, seeds):
        reference = next_reference(reference, observation)
        seen.append(np.stack(features(observation, reference), axis=-1))
        fallen.append(terminated)
    inputs, down = np.array(seen), np.array(fallen)  # (t, n, 8), (t, n)
    fall_step = np.where(down.any(axis=0), down.argmax(axis=0), len(down) + 10**6)
    time = np.arange(len(down))[:, None]
    before = (time >= SETTLING) & (time < fall_step)
    labels = fall_step - time <= round(HORIZON / CONTROL_PERIOD)
    return inputs[before], labels[before]


def logistic(inputs: Floats, labels: NDArray[np.bool_]) -> Floats:
    """Coefficients of the logistic regression of labels (m,) on inputs (m, k), (k,), by Newton's method."""
    beta = np.zeros(inputs.shape[1])
    for _ in range(ROUNDS):
        chance = 1.0 / (1.0 + np.exp(-np.clip(inputs @ beta, -30.0, 30.0)))
        gradient = inputs.T @ (labels - chance) - RIDGE * beta
        curvature = (inputs * (chance * (1.0 - chance))[:, None]).T @ inputs + RIDGE * np.eye(len(beta))
        beta = beta + np.linalg.solve(curvature, gradient)
    return beta


def undisturbed(policy: Policy, predictor: FallPredictor, seeds: NDArray[np.int64]) -> float:
    """The largest log-odds in undisturbed walking."""
    largest = -np.inf
    for chunk in np.array_split(seeds, -(-len(seeds) // 512)):
        reference = np.zeros((len(chunk), 2))
        for observation, _ in steps_of(policy, scenario("flat"), chunk):
            reference = next_reference(reference, observation)
            largest = max(largest, float(predictor.log_odds(observation, reference).max()))
    return largest


if __name__ == "__main__":
    raise SystemExit(launcher.launch(main))
