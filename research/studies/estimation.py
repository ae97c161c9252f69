"""Errors of estimated attitude and velocity: `python -m research estimation`.

A trot walks on estimates at 0.5 to 1 m/s, in the same episodes with each estimator. One error is of the estimate for
the time of the readings; the other is of the observation, which is a control step later with sensors of that delay.
Both are root mean squares over robots and control steps, after the first second and before a fall. With `--table
pushes` robots on the hardware profile are pushed twice an episode, and errors are for the time after.

NEES is the normalised estimation error squared eᵀ P⁻¹ e of tilt (two entries) and velocity (three), where P is the
estimator's covariance: 5 on average if the covariance is right. 95 % of the means over n runs lie in the band of χ²
with 5 n degrees of freedom (Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation,
2001).
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evaluate.hardware import IDEAL, HardwareConfig, check_hardware
from evaluate.rollouts.observers import FallRecorder, Step
from evaluate.rollouts.rollout import STEPS, roll_out
from policies.base import Floats
from policies.legs.level_frame import level_frame
from quad_env import SCENARIOS
from quad_env.actuation.hardware import hardware_profile
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.cli.format import ABSENT
from quad_env.robots.registry import get_robot
from quad_env.scenarios.registry import scenario as named
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import SmoothRandom
from quad_env.seeding import episode_seeds
from quad_env.sensing.channel import delay_to_steps
from quad_env.sensing.error_state import TILT, VELOCITY
from quad_env.sensing.estimators import ESTIMATORS
from quad_env.sensing.kalman import KalmanFilter
from quad_env.sensing.suite import sensor_suite
from research.pages.places import RESULTS, read_page, write_block

SETTLING = 100
"""Number of control steps from the start that do not count."""
NEES_DIMENSION = 5
"""Number of entries of the error in NEES."""
FORWARD, YAW_RATE = (0.5, 1.0), (-1.2, 1.2)
"""Commands, m/s and rad/s."""
PUSHES = "pushes"
"""Name of the block in the page for the errors after pushes."""
ROBOTS = ("simple_quad", "go1", "go2")
"""Robots that are pushed."""
WINDOWS = ((-50, 0), (0, 10), (10, 20), (20, 30), (30, 50), (50, 100), (100, 200))
"""Windows after the start of a push in which errors are averaged, control steps from and to."""
_LIMITS = {"episodes": (2, 4096), "seed": (0, 2**31), "ground": (0, 2**31), "threads": (1, 256)}


@dataclass(frozen=True)
class EstimationOptions:
    """Measure the estimators."""

    table: Literal["walks", "pushes"] = "walks"
    """Errors on walks, or after pushes of 35 N·s, scaled to the robot."""
    policy: str = "trot"
    """Policy that walks: a name or a folder, as for python -m evaluate."""
    sensors: str = "typical"
    """Sensors on walks, one of quad_env.SENSORS: ideal or typical."""
    episodes: int = 32
    """Episodes of 10 s in each row (count)."""
    seed: int = 0
    """Which set of episodes (whole number from 0)."""
    seeds: Literal["search", "validation", "evaluation"] = "validation"
    """Family of seeds."""
    ground: int = 1
    """Field of random ground: 0 is the evaluation's, 1 that of validations, 2 that of searches."""
    threads: int = 1
    """Threads of the simulation."""
    page: Path | None = None
    """File with the lines <!-- results --> and <!-- /results -->, or pushes, between which the table goes."""


class EstimationErrors(NamedTuple):
    """Errors of one estimator in n episodes; entries after a fall are NaN."""

    tilt: Floats
    """Roll and pitch at the time of the readings, rad, (steps, n, 2)."""
    velocity: Floats
    """Velocity at the time of the readings, m/s, (steps, n, 3)."""
    shown: Floats
    """Velocity in the observation, m/s, (steps, n, 3)."""
    nees: Floats
    """NEES, (steps, n); NaN without a covariance."""


def main(options: EstimationOptions) -> int:
    """Measure, print, write the table, and return the exit code. Raises UsageError."""
    check_numbers(options, _LIMITS)
    try:
        check_hardware(HardwareConfig(sensors=options.sensors, estimator=ESTIMATORS[-1]))
    except ValueError as error:
        raise UsageError(f"--sensors: {error}") from error
    place = RESULTS if options.table == "walks" else PUSHES
    if options.page is not None:
        read_page(options.page, place)
    lines = []
    for line in (walk_table if options.table == "walks" else push_table)(
        options
    ):  # shown as they come: a row takes minutes
        print(line, flush=True)
        lines.append(line)
    write_block(options.page, lines, place)
    return 0


def walk_table(options: EstimationOptions) -> Iterator[str]:
    """Yield the lines of a Markdown table: a row per ground and estimator."""
    columns = ("walk", "estimator", "velocity, m/s", "shown", "of it level", "roll, pitch, °", "NEES", "steps within")
    yield f"| {' | '.join(columns)} |"
    yield "|---" * len(columns) + "|"
    for name, scenario in walk_scenarios(options.ground).items():
        for estimator in ESTIMATORS:
            found = estimate_errors(options, scenario, estimator)
            roll, pitch = np.degrees(rms(found.tilt[..., :1])), np.degrees(rms(found.tilt[..., 1:]))
            velocity, shown, level = map(rms, (found.velocity, found.shown, found.shown[..., :2]))
            cells = [name, estimator, *(f"{each:.3f}" for each in (velocity, shown, level)), f"{roll:.2f}, {pitch:.2f}"]
            yield f"| {' | '.join([*cells, *consistency(found.nees)])} |"
    low, high = nees_bounds(options.episodes)
    words = f"`{options.policy}`, sensors `{options.sensors}`, {options.episodes} episodes of each row"
    yield ""
    yield f"{words}, {options.seeds} seeds; 95 % band of NEES {low:.2f} to {high:.2f}."


def walk_scenarios(ground: int) -> dict[str, Scenario]:
    """Return name -> scenario; the rough ground is the field of that number."""
    ranges: dict[str, Any] = {"forward": FORWARD, "lateral": (0.0, 0.0), "yaw_rate": YAW_RATE, "zero_fraction": 0.0}
    named = map(SCENARIOS.__getitem__, ("flat", "rough"))
    flat, rough = (replace(each, commands=replace(each.commands, **ranges)) for each in named)
    assert isinstance(rough.terrain, SmoothRandom)
    rough = replace(rough, terrain=replace(rough.terrain, seed=ground))
    straight = replace(flat, commands=replace(flat.commands, yaw_rate=(0.0, 0.0)))
    return {"flat": flat, "rough, 0.12 m": rough, "flat, straight on": straight}


def push_table(options: EstimationOptions) -> Iterator[str]:
    """Yield the lines of a Markdown table of velocity errors: a row per robot and estimator.

    Each cell has the error at the readings and the error in the observation.
    """
    first, *later = WINDOWS
    times = [f"{-first[0] / 100:g} s before", *(f"{start / 100:g} to {end / 100:g} s" for start, end in later)]
    columns = ("robot", "estimator", *times)
    yield f"| {' | '.join(columns)} |"
    yield "|---" * len(columns) + "|"
    for robot in ROBOTS:
        for estimator in ESTIMATORS:
            profile = hardware_profile(get_robot(robot))._asdict() | {"estimator": estimator}
            watch = _observe_walks(options, named("push", robot), replace(HardwareConfig(robot=robot), **profile))
            found = watch.errors(watch.falls.step)
            both = zip(*(error_after_push(each, watch.pushes) for each in (found.velocity, found.shown)), strict=True)
            yield f"| {' | '.join((robot, estimator, *(f'{now:.3f}, {shown:.3f}' for now, shown in both)))} |"
    yield ""
    episodes = f"{options.episodes} episodes of each row, {options.seeds} seeds"
    yield f"`{options.policy}` on the hardware profile, two pushes an episode, {episodes}."


def error_after_push(vectors: Floats, pushes: NDArray[np.int64]) -> list[float]:
    """Compute the RMS error in each window after each push.

    Args:
        vectors: Errors from SETTLING on, (steps, n, 3); NaN after a fall.
        pushes: Control steps at which the pushes begin, (n, k).

    Returns:
        The RMS of each window.
    """
    out = []
    for start, end in WINDOWS:
        parts = [
            vectors[max(push - SETTLING + start, 0) : push - SETTLING + end, row]
            for (row, _), push in np.ndenumerate(pushes)
        ]
        out.append(rms(np.concatenate(parts)))
    return out


def estimate_errors(options: EstimationOptions, scenario: Scenario, estimator: str) -> EstimationErrors:
    """Measure the errors of an estimator.

    Args:
        options: Options of the command.
        scenario: Scenario of the walks.
        estimator: Name of the estimator.

    Returns:
        Errors in all episodes.
    """
    watch = _observe_walks(options, scenario, HardwareConfig(sensors=options.sensors, estimator=estimator))
    return watch.errors(watch.falls.step)


def _observe_walks(
    options: EstimationOptions, scenario: Scenario, hardware: HardwareConfig
) -> "EstimationErrorObserver":
    """Run the walks of the options and return their observer."""
    real = hardware.actuator != IDEAL.actuator
    policy, suite = hardware.policy(options.policy, on_hardware_profile=real), sensor_suite(hardware.sensors)
    assert suite is not None
    parts = suite.imu, suite.encoders, suite.feet
    late = max(delay_to_steps(part.delay, 1 / policy.control_period) for part in parts)
    seeds = episode_seeds(options.seeds, options.seed, options.episodes)
    watch = EstimationErrorObserver(late, FallRecorder(len(seeds), STEPS))
    roll_out(policy, scenario, seeds, watch.falls, watch, steps=STEPS, nthread=options.threads, hardware=hardware)
    return watch


def rms(vectors: Floats) -> float:
    """Return the root of the mean squared length of vectors, (…, k)."""
    return float(np.sqrt(np.nanmean((vectors**2).sum(axis=-1))))


def nees_bounds(runs: int) -> tuple[float, float]:
    """Return the band in which 95 % of the means of NEES over that number of runs lie."""
    from scipy.stats import chi2

    low, high = chi2.ppf((0.025, 0.975), NEES_DIMENSION * runs) / runs
    return float(low), float(high)


def consistency(nees: Floats) -> tuple[str, str]:
    """Format the mean of NEES, (steps, n), and the share of the steps with a mean within the band."""
    if np.isnan(nees).all():
        return ABSENT, ABSENT
    means, (low, high) = np.nanmean(nees, axis=1), nees_bounds(nees.shape[1])
    return f"{np.nanmean(nees):.2f}", f"{((means >= low) & (means <= high)).mean():.0%}"


class EstimationErrorObserver:
    """Observes the errors of estimates with a delay, and of the observation."""

    def __init__(self, late: int, falls: FallRecorder) -> None:
        self.falls = falls
        self._truths: deque[tuple[Floats, Floats]] = deque(maxlen=late + 1)
        self._rows: list[tuple[Floats, ...]] = []

    def __call__(self, step: Step) -> None:
        """Record the errors of a step."""
        count = len(step.observation)
        state, estimator = step.env.simulation.state((np.zeros(count),) * 3), step.env.estimator
        assert estimator is not None
        self.pushes = step.env.pushes.first_step
        gravity, velocity = np.transpose(state.projected_gravity), np.transpose(state.linear_velocity)
        self._truths.append((gravity, velocity))
        if step.number <= SETTLING:
            return
        then: Any = estimator.nominal if isinstance(estimator, KalmanFilter) else estimator
        true_gravity, true_velocity = self._truths[0]
        turned, velocity_error = np.cross(then.gravity, true_gravity), true_velocity - then.velocity
        tilt = roll_pitch(true_gravity) - roll_pitch(then.gravity)
        nees = np.full(count, np.nan)
        if isinstance(estimator, KalmanFilter):
            nees = normalized_error_squared(then.gravity, turned, velocity_error, estimator.covariance)
        self._rows.append((tilt, velocity_error, velocity - estimator.velocity, nees))

    def errors(self, fall_step: NDArray[np.int64]) -> EstimationErrors:
        """Return the errors, without those after falls."""
        found = EstimationErrors._make(np.array(column) for column in zip(*self._rows, strict=True))
        fallen = np.arange(SETTLING, SETTLING + len(found.nees))[:, None] >= fall_step
        for each in found:
            each[fallen] = np.nan
        return found


def roll_pitch(gravity: Floats) -> Floats:
    """Compute roll and pitch of unit vectors of gravity in the base frame, rad, (…, 3) to (…, 2).

    Positive are left side up, and nose down.
    """
    frame = level_frame(np.moveaxis(gravity, -1, 0))
    return np.stack((frame.roll, frame.pitch), axis=-1)


def normalized_error_squared(gravity: Floats, turned: Floats, velocity_error: Floats, covariance: Floats) -> Floats:
    """Compute the NEES of tilt and velocity.

    A rotation about gravity is no tilt; the two entries are along axes normal to gravity.

    Args:
        gravity: Estimated gravity, base frame, unit vectors, (n, 3).
        tilt_error: Rotation from the estimated to the true gravity, rad, (n, 3).
        velocity_error: True minus estimated velocity, m/s, (n, 3).
        covariance: Covariance of the estimator's error state, (n, k, k).

    Returns:
        NEES, (n,).
    """
    across = np.cross(gravity, (1.0, 0.0, 0.0))
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    entries = np.zeros((len(gravity), NEES_DIMENSION, 6))
    entries[:, 0, :3], entries[:, 1, :3], entries[:, 2:, 3:] = across, np.cross(gravity, across), np.eye(3)
    places = np.r_[TILT, VELOCITY]
    error = (entries @ np.concatenate((turned, velocity_error), axis=1)[..., None])[..., 0]
    claimed = entries @ covariance[:, places][:, :, places] @ np.swapaxes(entries, -1, -2)
    weighed: Floats = (error[:, None] @ np.linalg.solve(claimed, error[..., None]))[:, 0, 0]
    return weighed
