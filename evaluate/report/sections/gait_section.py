"""Gait diagrams: each policy simulated for a few seconds on level ground at one speed, as a look at how it walks."""

import numpy as np
from numpy.typing import NDArray

import policies
from evaluate.analysis.results import Results
from evaluate.measures.footfalls import stances
from evaluate.report.html import grid, image, note, section
from evaluate.report.plots.drawing import Margins, figure, short_name, style, svg, text_width
from evaluate.rollouts import rollout
from evaluate.rollouts.experiment import evaluation_seeds
from evaluate.rollouts.hardware import Hardware
from policies.base import CONTROL_PERIOD
from quad_env.config import CommandRanges
from quad_env.robots.robot import Robot
from quad_env.robots.similarity import scaled
from quad_env.scenarios.named import Scenario

SPEED = 0.7
"""Forward, m/s of SimpleQuad; another robot's is as fast for its size."""
START, END = 3.0, 5.0
"""Shown, s from the start of the episode."""


def steady(robot: Robot) -> Scenario:
    """Straight ahead on level ground."""
    return Scenario("steady", commands=CommandRanges.straight(scaled(robot, SPEED, "m/s")))


def gaits(results: Results) -> str:
    """A diagram for each policy that is still upright; policies that are not to be found any more are named."""
    images, left_out = [], []
    for policy in results.policies:
        try:
            contact = footfalls(policy, int(evaluation_seeds(results.seed, 1)[0]), results.hardware)
        except (policies.PolicyError, OSError):
            left_out.append(f"{policy} (not to be found any more)")
            continue
        if not len(contact):
            left_out.append(f"{policy} (fallen by then)")
            continue
        drawn = gait_diagram(
            results.hardware.quadruped, contact, START, CONTROL_PERIOD, style(results, policy)[0], policy
        )
        images.append(image(drawn, f"When each foot of {policy} is on the ground"))
    ahead, _ = steady(results.hardware.quadruped).commands.forward
    lead = note(
        f"Feet on the ground from {START:g} to {END:g} s of an episode on level ground, commanded {ahead:.2g} m/s "
        "ahead. A row a foot, front or hind, left or right; diagonal pairs stand together."
    )
    missing = note(f"Without {', '.join(left_out)}.") if left_out else ""
    return section("Gait", lead, grid(images, 2), missing) if images else ""


def footfalls(policy: str, seed: int, hardware: Hardware) -> NDArray[np.bool_]:
    """Feet on the ground, (steps, 4), from START on; none of a robot that fell before END."""
    steps = round(END / CONTROL_PERIOD)
    scenario = steady(hardware.quadruped)
    probe = rollout.run(hardware.policy(policy), scenario, np.array([seed]), steps=steps, hardware=hardware)
    first = round(START / CONTROL_PERIOD) if probe.fall_step[0] == steps else steps
    return probe.foot_contact[first:, 0]


def gait_diagram(robot: Robot, contact: NDArray[np.bool_], start: float, dt: float, colour: str, title: str) -> bytes:
    """A bar wherever a foot is on the ground; contact (steps, 4) in the order of the robot's legs, from `start` on, s.

    Diagonal pairs stand together: in a trot their bars agree.
    """
    order = [leg for pair in robot.diagonals for leg in pair]
    names = [robot.leg_names[leg].upper() for leg in order]
    drawn, axes = figure(1.5, margins=Margins(left=0.22 + max(map(text_width, names)), right=0.25, top=0.28))
    for row, leg in enumerate(order):
        bars = [(start + first * dt, count * dt) for first, count in stances(contact[:, leg])]
        axes.broken_barh(bars, (row - 0.36, 0.72), facecolors=colour)
    axes.set_yticks(range(len(order)), names)
    axes.set(ylim=(len(order) - 0.5, -0.5), xlim=(start, start + len(contact) * dt))
    axes.set(xlabel="s", title=short_name(title))
    return svg(drawn)
