"""Threshold of the safety layer's fall predictor: above what undisturbed walking reaches, by a margin."""

import json

import numpy as np
from rich.progress import track

import policies
from evaluate.rollouts.observers import Step
from evaluate.rollouts.rollout import STEPS, roll_out
from policies.base import CONTROL_PERIOD, Policy
from policies.safety.fall_prediction import THRESHOLD_FILE, next_recent, next_reference, velocity_deviation
from quad_env.seeding import episode_seeds
from train.search.subject import Effort, Options, Outcome, Seeds, Subject

WALKING = "trot"
"""Policy that must not cause alarms."""
MARGIN = 0.2
"""Between the threshold and the largest velocity deviation of undisturbed walking, m/s."""
AT_ONCE = 512
"""Episodes simulated together."""


def subject(options: Options, effort: Effort) -> Subject[None]:
    """The fit of the threshold: nothing is searched."""
    seeds = episode_seeds("search", options.seed * 100 + 50, effort.episodes)

    def conclude(_: None) -> Outcome:
        chunks = np.array_split(seeds, -(-len(seeds) // AT_ONCE))
        largest = max(undisturbed(policies.make(WALKING), each) for each in track(chunks, description="walking"))
        hours = len(seeds) * STEPS * CONTROL_PERIOD / 3600
        text = json.dumps({"velocity_deviation": round(largest + MARGIN, 4)}, indent=2) + "\n"
        return Outcome(text, f"largest velocity deviation in {hours:.2f} h: {largest:.3f} m/s")

    return Subject(None, THRESHOLD_FILE, conclude)


def undisturbed(policy: Policy, seeds: Seeds) -> float:
    """The largest velocity deviation in undisturbed walking on flat ground, m/s."""
    reference, recent, largest = np.zeros((len(seeds), 2)), np.zeros((len(seeds), 2)), 0.0

    def watch(step: Step) -> None:
        nonlocal reference, recent, largest
        if step.number:
            reference = next_reference(reference, step.observation, step.env.dt)
            largest = max(largest, float(velocity_deviation(step.observation, reference, recent).max()))
            recent = next_recent(recent, step.observation, step.env.dt)

    roll_out(policy, "flat", seeds, watch)
    return largest
