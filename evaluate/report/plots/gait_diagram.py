"""Gait diagram: when each foot is on the ground."""

import numpy as np
from numpy.typing import NDArray

from evaluate.report.plots.drawing import Margins, figure, short_name, svg, text_width
from quad_env.robots.robot import Robot


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


def stances(contact: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First step and length of every stretch on the ground, of (steps,)."""
    change = np.diff(np.concatenate(([False], contact, [False])).astype(np.int8))
    first, end = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    return list(zip(first.tolist(), (end - first).tolist(), strict=True))
