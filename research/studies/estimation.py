"""Errors of estimated attitude and velocity: `python -m research estimation`.

A trot that uses the estimates walks at 0.5 to 1 m/s, in the same episodes with each estimator. The table shows two
velocity errors. The first compares the estimate with the true velocity at the time of its sensor readings. The second
compares the observation with the true velocity at the time of the action, which is later if the sensors have a delay.
Both are root mean squares over robots and control steps, after the first second and before a fall. With `--table
pushes`, robots with the hardware profile (models of real motors and sensors) are pushed twice in each episode. The
errors are then measured before and after the pushes.

NEES, the normalised estimation error squared, is eᵀ P⁻¹ e. The error e has two components of tilt and three of
velocity; P is the estimator's covariance of e. If P is right, the mean of NEES is 5, and the sum over n episodes has a
χ² distribution with 5 n degrees of freedom. The last column is the fraction of the control steps at which the mean over
the episodes is in the 95 % band (Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and
Navigation, 2001).
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
from quad_env.sensing.estimators import ESTIMATORS
from quad_env.sensing.kalman import KalmanFilter
from quad_env.sensing.kalman_models import TILT, VELOCITY
from quad_env.sensing.sensor_models import delay_to_steps
from quad_env.sensing.suite import sensor_suite
from research.pages.blocks import RESULTS, read_page, write_block

SETTLING = 100
"""Number of control steps at the start of an episode in which no errors are measured: 1 s."""
NEES_DIMENSION = 5
"""Dimension of the error vector of the NEES: two tilt errors and three velocity errors.

NEES is the normalised estimation error squared, a measure of the consistency of a filter's covariance.
"""
FORWARD = (0.5, 1.0)
"""Range from which the forward velocity command of the undisturbed walks is drawn, m/s."""
YAW_RATE = (-1.2, 1.2)
"""Range from which the yaw rate command of the undisturbed walks is drawn, rad/s."""
PUSHES = "pushes"
"""Name of the part of a Markdown page into which `estimation` writes the velocity errors after pushes.

The part is between the lines `<!-- pushes -->` and `<!-- /pushes -->`.
"""
ROBOTS = ("simple_quad", "go1", "go2")
"""Names of the robots for which the velocity errors before and after pushes are measured."""
WINDOWS = ((-50, 0), (0, 10), (10, 20), (20, 30), (30, 50), (50, 100), (100, 200))
"""Time windows in which errors are averaged: (start, end), control steps of 10 ms.

Start and end of a window are counted from the start of a push; a negative number is before the push.
"""
_LIMITS = {"episodes": (2, 4096), "seed": (0, 2**31), "ground": (0, 2**31), "threads": (1, 256)}
"""Name of an option -> smallest and largest valid value."""


@dataclass(frozen=True)
class EstimationOptions:
    """Options of the command `estimation`, which measures the errors of the state estimators."""

    table: Literal["walks", "pushes"] = "walks"
    """walks: errors on undisturbed walks; pushes: errors after pushes of 35 N·s, scaled to the robot."""
    policy: str = "trot"
    """Name or folder of the policy that walks, as for python -m evaluate."""
    sensors: str = "typical"
    """Sensors on undisturbed walks, one of quad_env.SENSORS: ideal or typical."""
    episodes: int = 32
    """Number of episodes of 10 s for each estimator on each scenario or robot."""
    seed: int = 0
    """Seed of the episodes, >= 0."""
    seeds: Literal["search", "validation", "evaluation"] = "validation"
    """Purpose of the seeds; seeds of different purposes are disjoint."""
    ground: int = 1
    """Seed of the random rough ground: 0 for evaluation, 1 for validation, 2 for search."""
    threads: int = 1
    """Number of threads of the simulation."""
    page: Path | None = None
    """Markdown file; the table is written between <!-- results --> and <!-- /results -->. With --table pushes, it is
    written between <!-- pushes --> and <!-- /pushes -->."""


class EstimationErrors(NamedTuple):
    """Errors (true minus estimated) of one estimator in n episodes; values after a fall are NaN.

    The sensor readings are delayed. Therefore an estimate is compared with the true state at the time at which its
    readings were measured. The first axis of each array has the control steps from SETTLING on.
    """

    tilt: Floats
    """Error of estimated roll and pitch at the time of the sensor readings, (steps, episodes, 2), rad."""
    velocity: Floats
    """Error of the trunk velocity that is estimated for the time of the sensor readings.

    True minus estimated velocity, base frame, (steps, episodes, 3), m/s."""
    observed_velocity: Floats
    """Error of the trunk velocity in the observation, at the time of the action of the policy.

    True minus observed velocity, base frame, (steps, episodes, 3), m/s."""
    nees: Floats
    """Normalised estimation error squared eᵀ P⁻¹ e, (steps, episodes), dimensionless.

    The NEES measures how well the estimator's covariance P fits the errors e of tilt and velocity. It is NaN if the
    estimator has no covariance."""


def main(options: EstimationOptions) -> int:
    """Run the command `estimation`: measure the errors of the estimators, and print and write the table.

    Args:
        options: Options of the command.

    Returns:
        Exit code of the process.

    Raises:
        UsageError: An option is invalid.
    """
    check_numbers(options, _LIMITS)
    try:
        check_hardware(HardwareConfig(sensors=options.sensors, estimator=ESTIMATORS[-1]))
    except ValueError as error:
        raise UsageError(f"--sensors: {error}") from error
    marker = RESULTS if options.table == "walks" else PUSHES
    if options.page is not None:
        read_page(options.page, marker)
    table = walk_table if options.table == "walks" else push_table
    lines = []
    # Each line is printed immediately, because the measurement of a row takes minutes.
    for line in table(options):
        print(line, flush=True)
        lines.append(line)
    write_block(options.page, lines, marker)
    return 0


def walk_table(options: EstimationOptions) -> Iterator[str]:
    """Yield the lines of the Markdown table of estimation errors on undisturbed walks.

    A row is about one scenario and one estimator. The columns are root-mean-square errors of the velocity, m/s, and of
    roll and pitch, °, and the NEES. NEES is the normalised estimation error squared, which measures the consistency of
    the estimator's covariance. `options` has the policy, the sensors and the seeds.
    """
    columns = ("walk", "estimator", "velocity, m/s", "shown", "of it level", "roll, pitch, °", "NEES", "steps within")
    yield f"| {' | '.join(columns)} |"
    yield "|---" * len(columns) + "|"
    for name, scenario in walk_scenarios(options.ground).items():
        for estimator in ESTIMATORS:
            cells = (name, estimator, *_walk_cells(estimate_errors(options, scenario, estimator)))
            yield f"| {' | '.join(cells)} |"
    low, high = nees_bounds(options.episodes)
    settings = f"`{options.policy}`, sensors `{options.sensors}`, {options.episodes} episodes of each row"
    yield ""
    yield f"{settings}, {options.seeds} seeds; 95 % band of NEES {low:.2f} to {high:.2f}."


def _walk_cells(errors: EstimationErrors) -> tuple[str, ...]:
    """Format the errors of one estimator on one scenario as cells of a row in `walk_table`."""
    roll = np.degrees(rms(errors.tilt[..., :1]))
    pitch = np.degrees(rms(errors.tilt[..., 1:]))
    velocities = (rms(errors.velocity), rms(errors.observed_velocity), rms(errors.observed_velocity[..., :2]))
    return (*(f"{value:.3f}" for value in velocities), f"{roll:.2f}, {pitch:.2f}", *consistency(errors.nees))


def walk_scenarios(ground: int) -> dict[str, Scenario]:
    """Create the scenarios of the undisturbed walks.

    Args:
        ground: Seed of the random rough ground.

    Returns:
        Name in the table -> scenario.
    """
    ranges: dict[str, Any] = {"forward": FORWARD, "lateral": (0.0, 0.0), "yaw_rate": YAW_RATE, "zero_fraction": 0.0}
    flat, rough = (
        replace(nominal, commands=replace(nominal.commands, **ranges))
        for nominal in (SCENARIOS["flat"], SCENARIOS["rough"])
    )
    assert isinstance(rough.terrain, SmoothRandom)
    rough = replace(rough, terrain=replace(rough.terrain, seed=ground))
    straight = replace(flat, commands=replace(flat.commands, yaw_rate=(0.0, 0.0)))
    return {"flat": flat, "rough, 0.12 m": rough, "flat, straight on": straight}


def push_table(options: EstimationOptions) -> Iterator[str]:
    """Yield the lines of the Markdown table of errors of the trunk velocity before and after pushes.

    A row is about one robot and one state estimator. A column is about one time window, for example 0.1 to 0.2 s after
    the start of a push. Each cell has two root-mean-square errors, m/s. The first is the error of the estimated
    velocity at the time at which the sensor readings were measured. The second is the error of the velocity in the
    observation at the time of the action, which is later if the sensors have a delay. `options` has the policy, the
    seeds and the number of episodes.
    """
    before, *after = WINDOWS
    times = [f"{-before[0] / 100:g} s before", *(f"{start / 100:g} to {end / 100:g} s" for start, end in after)]
    columns = ("robot", "estimator", *times)
    yield f"| {' | '.join(columns)} |"
    yield "|---" * len(columns) + "|"
    for robot in ROBOTS:
        for estimator in ESTIMATORS:
            profile = hardware_profile(get_robot(robot))._asdict() | {"estimator": estimator}
            hardware = replace(HardwareConfig(robot=robot), **profile)
            observer = _observe_walks(options, named("push", robot), hardware)
            yield f"| {' | '.join((robot, estimator, *_push_cells(observer)))} |"
    yield ""
    episodes = f"{options.episodes} episodes of each row, {options.seeds} seeds"
    yield f"`{options.policy}` on the hardware profile, two pushes an episode, {episodes}."


def _push_cells(observer: "EstimationErrorObserver") -> list[str]:
    """Format the velocity errors of one estimator as cells of `push_table`, one text per time window."""
    errors = observer.errors(observer.falls.step)
    at_readings = error_after_push(errors.velocity, observer.pushes)
    in_observation = error_after_push(errors.observed_velocity, observer.pushes)
    return [f"{first:.3f}, {second:.3f}" for first, second in zip(at_readings, in_observation, strict=True)]


def error_after_push(vectors: Floats, pushes: NDArray[np.int64]) -> list[float]:
    """Compute the root mean square (RMS) error in each time window around the pushes, over all pushes.

    WINDOWS has the start and end of each window, counted from the start of a push.

    Args:
        vectors: Error vectors of n robots from control step SETTLING on, (steps, n, 3); NaN after a fall.
        pushes: Control steps at which the k pushes of each robot begin, (n, k).

    Returns:
        The RMS error in each window, in the unit of `vectors`.
    """
    errors = []
    for start, end in WINDOWS:
        parts = [
            vectors[max(push - SETTLING + start, 0) : push - SETTLING + end, row]
            for (row, _), push in np.ndenumerate(pushes)
        ]
        errors.append(rms(np.concatenate(parts)))
    return errors


def estimate_errors(options: EstimationOptions, scenario: Scenario, estimator: str) -> EstimationErrors:
    """Simulate walks on a scenario, and measure the errors of an estimator.

    Args:
        options: Options of the command.
        scenario: Scenario of the walks.
        estimator: Name of the estimator.

    Returns:
        Errors at all control steps of all episodes.
    """
    hardware = HardwareConfig(sensors=options.sensors, estimator=estimator)
    observer = _observe_walks(options, scenario, hardware)
    return observer.errors(observer.falls.step)


def _observe_walks(
    options: EstimationOptions, scenario: Scenario, hardware: HardwareConfig
) -> "EstimationErrorObserver":
    """Simulate walks on a scenario, and record the errors of the estimator.

    Args:
        options: Options of the command: policy, seeds and number of episodes.
        scenario: Scenario of the walks.
        hardware: Robot, sensors and estimator.

    Returns:
        Observer with the recorded errors.
    """
    on_hardware_profile = hardware.actuator != IDEAL.actuator
    policy = hardware.policy(options.policy, on_hardware_profile=on_hardware_profile)
    suite = sensor_suite(hardware.sensors)
    assert suite is not None
    sensors = (suite.imu, suite.encoders, suite.feet)
    delay_steps = max(delay_to_steps(sensor.delay, 1 / policy.control_period) for sensor in sensors)
    seeds = episode_seeds(options.seeds, options.seed, options.episodes)
    observer = EstimationErrorObserver(delay_steps, FallRecorder(len(seeds), STEPS))
    roll_out(policy, scenario, seeds, observer.falls, observer, steps=STEPS, nthread=options.threads, hardware=hardware)
    return observer


def rms(vectors: Floats) -> float:
    """Return the root mean square of the lengths of vectors; vectors with a NaN component are ignored.

    `vectors` is an array (…, k) of vectors with k components.
    """
    return float(np.sqrt(np.nanmean((vectors**2).sum(axis=-1))))


def nees_bounds(runs: int) -> tuple[float, float]:
    """Return the bounds within which the mean NEES over `runs` episodes lies with 95 % probability.

    NEES is the normalised estimation error squared of a state estimator. The bounds hold for an estimator with a
    correct covariance; they are quantiles of the χ² distribution.
    """
    from scipy.stats import chi2

    low, high = chi2.ppf((0.025, 0.975), NEES_DIMENSION * runs) / runs
    return float(low), float(high)


def consistency(nees: Floats) -> tuple[str, str]:
    """Describe how well an estimator's covariance fits the errors, by the NEES.

    Args:
        nees: Normalised estimation error squared of n episodes, (steps, n); NaN if the estimator has no covariance.

    Returns:
        Two texts: the mean of the NEES, and the fraction of the control steps at which the mean over the episodes is
        within the 95 % bounds. Both are dashes if the estimator has no covariance.
    """
    if np.isnan(nees).all():
        return ABSENT, ABSENT
    means = np.nanmean(nees, axis=1)
    low, high = nees_bounds(nees.shape[1])
    return f"{np.nanmean(nees):.2f}", f"{((means >= low) & (means <= high)).mean():.0%}"


class EstimationErrorObserver:
    """Observer of a rollout that records the errors of an estimator and of the observed velocity.

    Args:
        delay_steps: Age of the sensor readings from which an estimate is made, control steps.
        falls: Recorder of the falls in the same rollout.
    """

    def __init__(self, delay_steps: int, falls: FallRecorder) -> None:
        self.falls = falls
        self._true_values: deque[tuple[Floats, Floats]] = deque(maxlen=delay_steps + 1)
        self._rows: list[tuple[Floats, ...]] = []

    def __call__(self, step: Step) -> None:
        """Record the errors of the estimates after a control step of all robots."""
        count = len(step.observation)
        state = step.env.simulation.state((np.zeros(count),) * 3)
        estimator = step.env.estimator
        assert estimator is not None
        self.pushes = step.env.pushes.first_step
        velocity = np.transpose(state.linear_velocity)
        self._true_values.append((np.transpose(state.projected_gravity), velocity))
        if step.number <= SETTLING:
            return
        estimate: Any = estimator.nominal if isinstance(estimator, KalmanFilter) else estimator
        true_gravity, true_velocity = self._true_values[0]
        velocity_error = true_velocity - estimate.velocity
        tilt_error = roll_pitch(true_gravity) - roll_pitch(estimate.gravity)
        nees = np.full(count, np.nan)
        if isinstance(estimator, KalmanFilter):
            rotation_error = np.cross(estimate.gravity, true_gravity)
            nees = normalized_error_squared(estimate.gravity, rotation_error, velocity_error, estimator.covariance)
        self._rows.append((tilt_error, velocity_error, velocity - estimator.velocity, nees))

    def errors(self, fall_step: NDArray[np.int64]) -> EstimationErrors:
        """Return the recorded errors, with NaN after a fall.

        Args:
            fall_step: Control step of each robot's fall, (n,); the number of steps if it did not fall.

        Returns:
            Errors from control step 100 (SETTLING) on, which is 1 s after the start of the episode.
        """
        errors = EstimationErrors._make(np.array(column) for column in zip(*self._rows, strict=True))
        has_fallen = np.arange(SETTLING, SETTLING + len(errors.nees))[:, None] >= fall_step
        for values in errors:
            values[has_fallen] = np.nan
        return errors


def roll_pitch(gravity: Floats) -> Floats:
    """Compute roll and pitch angles of the trunk from the direction of gravity.

    Args:
        gravity: Unit vectors in the direction of gravity, base frame, (…, 3).

    Returns:
        Roll and pitch, (…, 2), rad. Roll is positive if the left side is up. Pitch is positive if the front is down.
    """
    frame = level_frame(np.moveaxis(gravity, -1, 0))
    return np.stack((frame.roll, frame.pitch), axis=-1)


def normalized_error_squared(
    gravity: Floats, rotation_error: Floats, velocity_error: Floats, covariance: Floats
) -> Floats:
    """Compute the normalised estimation error squared eᵀ P⁻¹ e, with the error e and its covariance P.

    The error e has five components: the tilt error about two axes normal to gravity, because a rotation about gravity
    is no tilt, and the velocity error.

    Args:
        gravity: Estimated direction of gravity, base frame, unit vectors, (n, 3).
        rotation_error: Rotation vector from the estimated to the true gravity, base frame, (n, 3), rad.
        velocity_error: True minus estimated velocity, base frame, (n, 3), m/s.
        covariance: Covariance of the error state of the Kalman filter, (n, k, k); k is the size of the error state.

    Returns:
        NEES of n robots, (n,), dimensionless.
    """
    across = np.cross(gravity, (1.0, 0.0, 0.0))
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    projection = np.zeros((len(gravity), NEES_DIMENSION, 6))
    projection[:, 0, :3] = across
    projection[:, 1, :3] = np.cross(gravity, across)
    projection[:, 2:, 3:] = np.eye(3)
    indices = np.r_[TILT, VELOCITY]
    error = (projection @ np.concatenate((rotation_error, velocity_error), axis=1)[..., None])[..., 0]
    error_covariance = projection @ covariance[:, indices][:, :, indices] @ np.swapaxes(projection, -1, -2)
    nees: Floats = (error[:, None] @ np.linalg.solve(error_covariance, error[..., None]))[:, 0, 0]
    return nees
