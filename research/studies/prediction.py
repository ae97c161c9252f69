"""Predictions of the predictive controllers and what happens: `python -m research prediction`.

At every control step the plan predicts the state of the robot, as one rigid body, after each step of the horizon, and
the forces of its feet. MuJoCo gives the same quantities at those times: centre of mass, velocities and attitude of the
whole robot, forces of the contacts. All are in the level frame of the moment of the plan. Only the first control step
of a plan is executed, so the comparison tests the model and the controller's expectation of its own later steps.

A useful prediction has smaller errors than the assumption that height, velocities and attitude stay the same.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from evaluate.report.plots.drawing import COLOURS
from evaluate.rollouts.observers import Falls, Step
from evaluate.rollouts.rollout import STEPS, roll_out
from policies.base import Floats
from policies.mpc.policy import HORIZON, Mpc, MpcWbc
from policies.mpc.rigid_body import Body, Reference
from quad_env import SCENARIOS
from quad_env.cli.command_line import check_numbers
from quad_env.columns import Rows
from quad_env.robots.collisions import foot_geoms
from quad_env.robots.robot import Robot
from quad_env.scenarios.scenario import Scenario
from quad_env.seeding import episode_seeds
from research.pages.places import make_room_for_picture, page_with, put
from research.studies.estimation import norm, roll_pitch
from research.studies.ground import elsewhere

SETTLING = 100
"""Control steps from the start that do not count."""
GROUNDS = ("flat", "rough", "push")
AHEAD = (1, 5, 10)
"""Steps of the horizon after which errors are measured."""
COMMAND = (0.5, 0.0, 0.0)
"""Command of the drawn stride, m/s, m/s and rad/s."""
_LIMITS = {"episodes": (1, 4096), "seed": (0, 2**31), "ground": (0, 2**31), "start": (SETTLING, STEPS - 100)}


@dataclass(frozen=True)
class Options:
    """Compare predictions with what happens."""

    policy: Literal["mpc", "mpc_wbc"] = "mpc_wbc"
    """Policy that walks."""
    episodes: int = 8
    """Episodes of 10 s on each ground (count)."""
    seed: int = 0
    """Which set of validation episodes (whole number from 0)."""
    ground: int = 1
    """Field of the rough ground: 0 is the evaluation's, 1 that of validations, 2 that of searches."""
    start: int = 400
    """The stride that is drawn is the first one from this control step on."""
    out: Path = Path("results/prediction.png")
    """PNG to write."""
    page: Path | None = None
    """File with the lines <!-- prediction --> and <!-- /prediction -->, between which the table goes, such as
    docs/mpc.md."""


class WholeBody(NamedTuple):
    """Motion of a whole robot and what the ground does to it, world frame; of several with leading axes."""

    centre: Floats
    """Centre of mass, (3,), m."""
    velocity: Floats
    """Its velocity, (3,), m/s."""
    rotation: Floats
    """From the base to the world frame, (3, 3)."""
    turning: Floats
    """Angular velocity of the trunk, (3,), rad/s."""
    forces: Floats
    """Of the ground on each foot, (4, 3), N."""


def whole_body(robot: Robot, model: Any, data: Any) -> WholeBody:
    """What MuJoCo has of the robot in `data` now, derived fields current, such as those of `Simulation.snapshot`."""
    mujoco.mj_subtreeVel(model, data)
    trunk = model.body("base_link").id
    rotation, joint = data.xmat[trunk].reshape(3, 3).copy(), model.body_dofadr[trunk]
    feet = {geom: foot for foot, leg in enumerate(robot.leg_names) for geom in foot_geoms(model, leg)}
    forces, one = np.zeros((len(robot.leg_names), 3)), np.zeros(6)
    for number, contact in enumerate(data.contact):
        for place, geom in enumerate(contact.geom):
            if (foot := feet.get(int(geom))) is not None:
                mujoco.mj_contactForce(model, data, number, one)
                # It acts on the second of the two.
                sign = 1.0 if place == 1 else -1.0
                forces[foot] += sign * (contact.frame.reshape(3, 3).T @ one[:3])
    turning = rotation @ data.qvel[joint + 3 : joint + 6]
    return WholeBody(data.subtree_com[trunk].copy(), data.subtree_linvel[trunk].copy(), rotation, turning, forces)


class Walk(NamedTuple):
    """What n robots did, and the predictions."""

    measured: WholeBody
    """Before each control step, and after the last one."""
    rise: Floats
    """Predicted rise of the centre of mass after each step of the horizon, (steps, n, N), m."""
    velocity: Floats
    """Predicted velocity in the level frame of the plan's moment, (steps, n, N, 3), m/s."""
    tilt: Floats
    """Predicted change of roll and pitch, (steps, n, N, 2), rad."""
    forces: Floats
    """Planned forces of the feet in that frame, (steps, n, N, 4, 3), N."""
    phase: Floats
    """The policy's clock at each plan, (steps, n), rad."""
    fall_step: NDArray[np.int64]
    """Control step of each robot's fall, or the number of steps, (n,)."""


def main(options: Options) -> int:
    """Walk, print, draw, and write the table; the exit code. Raises UsageError."""
    check_numbers(options, _LIMITS)
    make_room_for_picture(options.out, "--out")
    if options.page is not None:
        page_with(options.page, "prediction")
    policy = MpcWbc() if options.policy == "mpc_wbc" else Mpc()
    lines = list(table(policy, options))
    seeds = episode_seeds("validation", options.seed, 1)
    draw(policy, walk(policy, "flat", seeds, COMMAND), options.start, options.out)
    put(options.page, lines, "prediction")
    print("\n".join([*lines, str(options.out)]))
    return 0


def table(policy: Mpc, options: Options) -> Iterator[str]:
    """Lines of a Markdown table: a row a ground and time ahead."""
    yield "| ground | ahead, s | height, mm | forward, lateral, m/s | upward, m/s | roll, pitch, ° |"
    yield "|---|---|---|---|---|---|"
    period = policy.parameters.horizon_step
    for name in GROUNDS:
        seeds = episode_seeds("validation", options.seed, options.episodes)
        found = walk(policy, elsewhere(SCENARIOS[name], options.ground), seeds)
        for steps in AHEAD:
            predicted, same = (errors(found, steps, period, policy.control_period, still) for still in (False, True))
            cells = (f"{a:.{n}f} ({b:.{n}f})" for a, b, n in zip(predicted, same, (1, 3, 3, 2), strict=True))
            yield f"| {name} | {steps * period:.2f} | {' | '.join(cells)} |"
    yield ""
    yield (
        f"`{policy.name}`, {options.episodes} validation episodes on each ground; root mean square errors, in brackets "
        "those of the assumption that nothing changes."
    )


def walk(
    policy: Mpc, scenario: str | Scenario, seeds: NDArray[np.int64], command: Any = None, steps: int = STEPS
) -> Walk:
    """An episode of `policy` for each seed; entries after a fall mean nothing."""
    falls, watch = Falls(len(seeds), steps), _Watch(policy)
    roll_out(policy, scenario, seeds, falls, watch, command=command, steps=steps)
    return watch.walk(falls.step)


def errors(found: Walk, steps: int, horizon_step: float, control_period: float, still: bool = False) -> Floats:
    """Root mean square errors of a prediction so many steps of the horizon ahead, shape (4,).

    Height, mm; horizontal and upward velocity, m/s; roll and pitch together, °. `still`: of the prediction that nothing
    changes.
    """
    late, at = round(steps * horizon_step / control_period), steps - 1
    heading = turned_back(found.measured.rotation[:-late])
    counts = np.arange(len(heading))[:, None]
    good = (counts >= SETTLING) & (counts + late <= found.fall_step)
    now, then = (WholeBody(*(each[part] for each in found.measured)) for part in (slice(-late), slice(late, None)))
    rise = 0.0 if still else found.rise[: len(heading), :, at]
    before = np.einsum("snij,snj->sni", heading, now.velocity)
    velocity = before if still else found.velocity[: len(heading), :, at]
    tilt = 0.0 if still else found.tilt[: len(heading), :, at]
    height = 1e3 * (then.centre[..., 2] - now.centre[..., 2] - rise)
    moved = np.einsum("snij,snj->sni", heading, then.velocity) - velocity
    leant = np.degrees(tilt_of(then.rotation) - tilt_of(now.rotation) - tilt)
    return np.array([norm(each[good]) for each in (height[..., None], moved[..., :2], moved[..., 2:], leant)])


def turned_back(rotation: Floats) -> Floats:
    """From the world frame to the level frame at each heading, (…, 3, 3), of rotations from the base."""
    yaw = np.arctan2(rotation[..., 1, 0], rotation[..., 0, 0])
    cosine, sine, zero = np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)
    rows = ((cosine, sine, zero), (-sine, cosine, zero), (zero, zero, zero + 1.0))
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def tilt_of(rotation: Floats) -> Floats:
    """Roll and pitch, (…, 2), rad, of rotations from the base to the world frame, (…, 3, 3)."""
    return roll_pitch(-rotation[..., 2, :])


class Forecast(NamedTuple):
    """Where robots go by their latest plans, each in the level frame where it was when these were made."""

    robots: Rows
    """Whose plans they are, (g,)."""
    body: Body
    """Where they were."""
    path: Reference
    """Where they are after each step of the horizon."""
    forces: Floats
    """Of the feet in each step, (g, N, 4, 3), N."""


def forecast(policy: Mpc) -> Forecast:
    """What the plans of the latest action that made some foresee."""
    assert policy._planned is not None
    robots, body, places = policy._planned
    forces = policy._plans.forces[robots]
    return Forecast(robots, body, policy._horizon.predicted(body, places, forces), forces)


class _Watch:
    """Observer that records what becomes a `Walk`."""

    def __init__(self, policy: Mpc) -> None:
        self._policy = policy
        self._measured: list[WholeBody] = []
        self._predicted: list[tuple[Floats, ...]] = []

    def __call__(self, step: Step) -> None:
        count = len(step.observation)
        simulation = step.env.simulation
        robots = [whole_body(simulation.robot, simulation.model, simulation.snapshot(i)) for i in range(count)]
        self._measured.append(WholeBody(*map(np.stack, zip(*robots, strict=True))))
        if not step.number:
            return
        # The action of the step that is done was chosen before it: by what was measured one step ago.
        found = forecast(self._policy)
        start, path = found.body, found.path
        predicted = (
            path.position[..., 2] - start.position[:, None, 2],
            path.velocity,
            path.angles[..., :2] - start.angles[:, None, :2],
            found.forces,
        )
        row = [np.full((count, *each.shape[1:]), np.nan) for each in predicted]
        for whole, part in zip(row, predicted, strict=True):
            whole[found.robots] = part
        self._predicted.append((*row, self._policy.phase.copy()))

    def walk(self, fall_step: NDArray[np.int64]) -> Walk:
        """The finished record."""
        measured = WholeBody(*(np.array(each) for each in zip(*self._measured, strict=True)))
        rise, velocity, tilt, forces, phase = (np.array(each) for each in zip(*self._predicted, strict=True))
        return Walk(measured, rise, velocity, tilt, forces, phase, fall_step)


def draw(policy: Mpc, found: Walk, start: int, out: Path) -> None:
    """Write the picture of the first robot's first stride from control step `start` on."""
    from matplotlib.figure import Figure

    stride = round(1.0 / (policy.frequency * policy.control_period))
    first = start + int(np.argmin(found.phase[start : start + stride, 0]))
    last = first + HORIZON * round(policy.parameters.horizon_step / policy.control_period)
    measured = WholeBody(*(each[first : last + 1, 0] for each in found.measured))
    velocity = measured.velocity @ turned_back(measured.rotation[0]).T
    lean = np.degrees(tilt_of(measured.rotation) - tilt_of(measured.rotation[0]))
    times = policy.control_period * np.arange(last - first + 1)
    ends = policy.parameters.horizon_step * np.arange(HORIZON + 1)
    rise, planned, tilt, forces = (each[first, 0] for each in (found.rise, found.velocity, found.tilt, found.forces))
    shown = (
        ("rise of the centre of mass, mm", 1e3 * (measured.centre[:, 2] - measured.centre[0, 2]), 1e3 * rise),
        ("forward velocity, m/s", velocity[:, 0], planned[:, 0]),
        ("upward velocity, m/s", velocity[:, 2], planned[:, 2]),
        ("change of pitch, °", lean[:, 1], np.degrees(tilt[:, 1])),
    )
    figure = Figure(figsize=(12, 5), layout="constrained")
    panels = figure.subplots(2, 4, sharex=True)
    for axes, (title, happened, predicted) in zip(panels[0], shown, strict=True):
        axes.plot(times, happened, color=COLOURS[0], label="measured")
        axes.plot(ends, (happened[0], *predicted), "o--", color=COLOURS[1], markersize=4, label="predicted")
        axes.set_title(title, fontsize=10, loc="left")
    for leg, axes in enumerate(panels[1]):
        axes.plot(times, measured.forces[:, leg, 2], color=COLOURS[0])
        axes.stairs(forces[:, leg, 2], ends, color=COLOURS[1], linestyle="--", baseline=None)
        axes.set_title(f"{policy.robot.leg_names[leg]}, upward force, N", fontsize=10, loc="left")
        axes.set_xlabel("time, s")
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper right", frameon=False, ncols=2)
    figure.savefig(out, dpi=90)
