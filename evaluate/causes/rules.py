"""Rules that find the cause of a failed episode: each function searches for one kind of cause.

A rule yields events. An event is a possible cause with a score, which is the measured quantity divided by a threshold.
An instantaneous event, for example a collision of a foot with a step, happens in one control step. A lasting event, for
example low friction or sensor noise, continues from the control step in which it begins.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evaluate.causes.record import SHANK_SAMPLES, EpisodeSignals
from evaluate.measures.averages import Bools, Floats, planar
from evaluate.measures.effort import LIMIT_MARGIN
from quad_env.config import GRAVITY
from quad_env.scenarios.episode import control_steps
from quad_env.scenarios.terrain import Flat, Slope, Stairs

Ints = NDArray[np.intp]

TRIP = "trip"
"""Cause of failure: a leg or the trunk hits an obstacle, for example a step."""
SLIP = "slip"
"""Cause of failure: stance feet slide on the ground."""
PUSH = "pushed_over"
"""Cause of failure: a push or a steady external force pushes the robot over."""
MOTOR = "motor_limit"
"""Cause of failure: motors are at their torque or speed limit, or servos lag behind their targets."""
REACH = "out_of_reach"
"""Cause of failure: a joint of a stance leg is at its limit, or the leg is almost fully stretched."""
ESTIMATE = "wrong_estimate"
"""Cause of failure: the policy observes a tilt or a velocity with a large error."""
SIGNAL = "late_or_lost_signal"
"""Cause of failure: observations or actions are delayed, or joint targets do not reach the servos."""
GAIT = "gait"
"""Cause of failure: the robot's own gait, because no rule finds another cause."""
SLOW = "too_slow"
"""Cause of failure: the upright robot follows the velocity command too slowly, but covers enough distance."""
STALLED = "stalled"
"""Cause of failure: the upright robot covers less than a minimum fraction of the commanded distance."""
POLICY = "policy_error"
"""Cause of failure: the policy raises an exception, answers too late, or returns no finite action."""
UNCLEAR = "unclear"
"""Cause of failure that is named if the rules cannot determine the cause."""
CAUSES = (TRIP, SLIP, PUSH, MOTOR, REACH, ESTIMATE, SIGNAL, GAIT, SLOW, STALLED, POLICY, UNCLEAR)
"""Names of all causes of failure, as in results.json; each failed episode has exactly one cause."""
CAUSE_RULE = "causes/1"
"""Version of the rules that determine causes of failure, as stored in manifest.json."""
TRIP_WINDOW_STEPS = 3
"""Number of control steps before a collision over which the speed of a leg is averaged."""
SATURATION_WINDOW_STEPS = 5
"""Number of control steps over which a motor torque is averaged before it is compared with its limit."""
MIN_TRIP_SCORE = 0.5
"""Minimum score with which a collision of a leg counts as an event (possible cause of a failure).

The score is the measured quantity divided by its threshold. An event needs a score of 1 to be the cause, but smaller
scores count in the decision if no event reaches 1.
"""


class Event(NamedTuple):
    """Event in a failed episode that may have caused the failure; the rules of this module find it."""

    cause: str
    """Name of the kind of cause, for example `trip` or `slip`."""
    step: int
    """Index of the control step in which the event began, counted from the start of the episode."""
    score: float
    """Measured quantity divided by its threshold; an event with a score of 1 or more can be the cause."""
    description: str
    """Description for the user, for example `front left foot hits the edge of a step (0.15 m) at 0.9 m/s`."""
    is_instantaneous: bool = False
    """True if the event happens in one control step, for example a collision; False if it lasts."""


def trips(record: EpisodeSignals, window: slice | None = None) -> Iterator[Event]:
    """Find trips: a swing leg hits an obstacle and loses speed at a place where the ground rises.

    Args:
        record: Signals of the failed episode.
        window: Range of control steps to search; None for the steps around the onset of the failure.

    Yields:
        The trip with the highest score in each control step in which a leg hits an obstacle.
    """
    window = window or record.window
    steps = np.arange(max(window.start, TRIP_WINDOW_STEPS), min(window.stop, record.end - 1))
    if not _can_rise(record) or not len(steps):
        return
    speed, speed_lost, rise = _shank_blows(record, steps)
    score = np.minimum(rise / record.threshold("rise"), speed_lost / record.threshold("speed lost"))
    score = score * _touching(record, steps)
    for row in np.flatnonzero(score.max(axis=(1, 2)) >= MIN_TRIP_SCORE):
        leg, sample = np.unravel_index(score[row].argmax(), score[row].shape)
        at = (row, leg, sample)
        part = "foot" if sample == len(SHANK_SAMPLES) - 1 else "shin"
        description = f"{_leg_name(record, int(leg))} {part} hits {_rise_text(record, float(rise[at]))}"
        description += f" at {speed[at]:.1f} m/s"
        yield Event(TRIP, int(steps[row]), float(score[at]), description, is_instantaneous=True)


def _shank_blows(record: EpisodeSignals, steps: Ints) -> tuple[Floats, Floats, Floats]:
    """Compute the quantities from which a collision of a shank is detected, at four points on each shank.

    Args:
        record: Signals of the failed episode.
        steps: Indices of the control steps in which a collision may have happened, (k,).

    Returns:
        speed: Mean horizontal speed of the point just before the possible collision, (k, 4 legs, 4 points), m/s.
        speed_lost: Decrease of the velocity component along the direction before the possible collision, (k, 4 legs, 4
            points), m/s.
        rise: Ground height ahead of the point minus ground height behind it, (k, 4 legs, 4 points), m.
    """
    points, velocity = record.shank
    before = _running_mean(velocity[..., :2], TRIP_WINDOW_STEPS)[steps - 1]
    after = (velocity[steps, ..., :2] + velocity[steps + 1, ..., :2]) / 2
    speed = planar(before)
    direction = before / np.maximum(speed, 1e-9)[..., None]
    speed_lost = speed - (after * direction).sum(axis=-1)
    return speed, speed_lost, _rise_ahead(record, points[steps, ..., :2], direction)


def _rise_ahead(record: EpisodeSignals, points: Floats, direction: Floats) -> Floats:
    """Return the ground height just ahead of moving points minus the ground height just behind them.

    Args:
        record: Signals of the failed episode, which contain the terrain.
        points: Horizontal positions of the points, world frame, x and y, (…, 2), m.
        direction: Direction of motion of each point as a unit vector, world frame, x and y, (…, 2).

    Returns:
        Difference of the ground heights, (…), m; positive if a point moves towards higher ground.
    """
    ahead = record.threshold("reach of a riser") * direction
    return np.asarray(record.ground(points + ahead) - record.ground(points - ahead))


def _touching(record: EpisodeSignals, steps: Ints) -> Bools:
    """Return the mask of the points on the shanks of swing legs that are in contact with an obstacle.

    A leg is a swing leg if its foot was in the air shortly before the control step. Each shank has four points; the
    last one is the foot. The contact of each foot is recorded separately. All other parts of the legs have one common
    contact signal.

    Args:
        record: Signals of the failed episode.
        steps: Indices of the control steps, (k,).

    Returns:
        True for points in contact, (k, 4 legs, 4 points).
    """
    contact = record.signal("foot_contact") > 0
    touching = np.repeat(contact[steps, :, None], len(SHANK_SAMPLES), axis=2)
    touching[..., :-1] = record.signal("leg_contact")[steps, None, None] > 0
    touching &= _running_mean(~contact, TRIP_WINDOW_STEPS)[steps - 1, :, None] > 0
    return touching


def trunk_blow(record: EpisodeSignals) -> Iterator[Event]:
    """Find a collision of the trunk with an obstacle, for example a step, that ended the episode.

    The collision counts only if the failure began shortly before and the tilt of the trunk was small. Otherwise the
    robot was already falling.
    """
    last = record.end - 1
    episodes = record.episodes
    is_ordinary = record.signal("tilt")[last] <= 2 * record.threshold("tilt") and record.onset >= last - record.steps(
        "look back"
    )
    if _can_rise(record) and is_ordinary and episodes.fall_reason[record.number] == "trunk_contact":
        reach = record.threshold("reach of a riser")
        x, y, z = episodes.robot.trunk_size / 2 + reach * np.array([1.0, 1.0, 0.0])
        corners = np.array([(x, y, -z), (x, -y, -z), (-x, y, -z), (-x, -y, -z)]) @ record.rotation[last].T
        ground_at_feet = record.ground(record.signal("foot_position")[last])
        ground_at_corners = record.ground(record.signal("position")[last] + corners)
        rise = float(ground_at_corners.max() - ground_at_feet.min())
        description = f"the trunk meets {_rise_text(record, rise)}"
        yield Event(TRIP, record.end, rise / record.threshold("trunk's rise"), description, is_instantaneous=True)


def slides(record: EpisodeSignals) -> Iterator[Event]:
    """Find slips: stance feet that slide on the ground.

    The score is smaller if the friction coefficient is high, because the controller rather than the ground then causes
    the sliding.
    """
    window = record.window
    friction = record.sampled.friction
    held = record.signal("foot_contact") > 0
    held[1:] &= held[:-1].copy()
    speed = planar(record.shank[1][window, :, -1])
    sliding = held[window] & (speed > record.threshold("slide"))
    if sliding.any():
        share = sliding.sum() / held[window].sum()
        mean_speed = speed[sliding].mean()
        description = f"{share:.0%} of the standing feet slide, at {mean_speed:.1f} m/s, friction {friction:g}"
        score = share / record.threshold("sliding") * min(1.0, record.threshold("grip") / friction)
        yield Event(SLIP, _first_step(window, sliding), float(score), description)


def pushes(record: EpisodeSignals) -> Iterator[Event]:
    """Find pushes shortly before the onset of a fall, and a steady external force that shifts the robot.

    The capture point is the point on the ground at which the robot would have to step to come to rest. The score of a
    push is the displacement of the capture point by the push, divided by a threshold. The score of a steady force is
    the force as a fraction of the robot's weight, divided by a threshold.
    """
    if not record.fell:
        return
    episodes = record.episodes
    latest = min(record.onset + episodes.push_steps, record.end - 1)
    push_steps = episodes.push_step[record.number].tolist()
    for step, impulse in zip(push_steps, episodes.push_impulse[record.number], strict=True):
        if record.onset - record.steps("push before") <= step <= latest:
            size = float(np.hypot(*impulse))
            speed = size * GRAVITY / episodes.weight
            description = f"a push of {size:.0f} N·s, {speed:.1f} m/s for its mass"
            score = speed * record.time_constant / record.threshold("push")
            yield Event(PUSH, step, score, description, is_instantaneous=True)
    if (force := record.sampled.force) is not None:
        size = float(np.hypot(*force))
        step = max(record.onset - 1, 0)
        offset = record.capture_point_offset[step:].mean(axis=0)
        if offset @ force > 0.5 * size * np.hypot(*offset):
            description = f"a steady force of {size:.0f} N, {size / episodes.weight:.2f} of the weight"
            yield Event(PUSH, step, size / episodes.weight / record.threshold("force"), description)


def motor_saturation(record: EpisodeSignals) -> Iterator[Event]:
    """Find motors at their torque or speed limit, and servos that follow their joint targets too slowly.

    A servo that follows its target too slowly counts only if the scenario limits the bandwidth of the servos.
    """
    yield _saturation(record)
    bandwidth = record.scenario.motors.bandwidth
    if bandwidth is not None:
        errors = np.abs(record.signal("action") - record.signal("joint_position"))[record.window]
        lag = float(errors.max(axis=1).mean())
        description = f"servos of {bandwidth:g} Hz are {lag:.2f} rad behind"
        yield Event(MOTOR, record.window.start, lag / record.threshold("lag"), description)


def _saturation(record: EpisodeSignals) -> Event:
    """Make the event for motors that were at their torque limit or speed limit.

    The speed limit counts only if the motor model has a torque-speed curve. The score is the fraction of joints and
    control steps at a limit, divided by its threshold.
    """
    window = record.window
    episodes = record.episodes
    limit = np.broadcast_to(episodes.torque_limit, episodes.joint_torque.shape[-1:])
    threshold = record.threshold("saturated")
    torque = _running_mean(record.signal("joint_torque") / limit, SATURATION_WINDOW_STEPS)[window]
    saturated = np.abs(torque) >= threshold
    has_torque_speed_curve = np.isfinite(episodes.joule_heat[0, record.number]).all()
    if has_torque_speed_curve:
        saturated |= (record.signal("peak_speed") / episodes.speed_limit)[window] >= threshold
    weakest = int(saturated.sum(axis=0).argmax())
    share = saturated[:, weakest].mean()
    motor = f"{_joint_name(record, weakest)} motor"
    description = f"{motor} is {share:.0%} of the time at its limit, {limit[weakest]:.3g} N·m"
    score = float(saturated.mean()) / record.threshold("saturated joints")
    return Event(MOTOR, _first_step(window, saturated), score, description)


def limits(record: EpisodeSignals) -> Iterator[Event]:
    """Find stance legs that cannot reach further, because a joint is at its limit or the leg is stretched.

    Only measured joint angles count. Joint targets do not count, because crouching gaits usually have targets beyond a
    joint limit.
    """
    window = record.window
    robot = record.episodes.robot
    joints = record.signal("joint_position")
    beyond = (joints <= robot.joint_lower + LIMIT_MARGIN) | (joints >= robot.joint_upper - LIMIT_MARGIN)
    thigh = robot.thigh_length
    calf = robot.calf_length
    length = np.sqrt(thigh**2 + calf**2 + 2 * thigh * calf * np.cos(joints[:, 2::3])) / (thigh + calf)
    standing = (record.signal("foot_contact") > 0)[window]
    legs = beyond.reshape(*length.shape, -1).any(axis=-1) | (length >= record.threshold("stretched"))
    if (at_limit := legs[window] & standing).any():
        share = float(at_limit.sum() / standing.sum())
        description = f"standing legs are {share:.0%} of the time at the limit of a joint, or stretched"
        yield Event(REACH, _first_step(window, at_limit), share / record.threshold("at limits"), description)


def estimation_error(record: EpisodeSignals) -> Iterator[Event]:
    """Find large errors of the tilt and the horizontal velocity that the policy observes.

    Each observation is compared with the true state at the time at which it was measured. A delay of the observation
    alone is therefore no error.
    """
    if record.episodes.observed is None:
        return
    steps = np.maximum(np.arange(record.end) - _observation_delay_steps(record), 0)
    observed = record.signal("observed")
    rotation = record.rotation[steps]
    down = observed[:, :3] / np.maximum(np.linalg.norm(observed[:, :3], axis=1), 1e-9)[:, None]
    tilt_error = np.arccos(np.clip(-(down * rotation[:, 2]).sum(axis=1), -1.0, 1.0))
    velocity_error = planar((rotation @ observed[:, 6:9, None])[:, :2, 0] - record.velocity[steps])
    tilt_rms = _root_mean_square(tilt_error[record.window])
    velocity_rms = _root_mean_square(velocity_error[record.window])
    score = max(tilt_rms / record.threshold("tilt estimate"), velocity_rms / record.threshold("velocity estimate"))
    description = f"the policy is shown a tilt that is {tilt_rms:.2f} rad wrong, a velocity {velocity_rms:.2f} m/s"
    yield Event(ESTIMATE, record.window.start, score, description)


def delay_or_dropout(record: EpisodeSignals) -> Iterator[Event]:
    """Find a delay of observations and actions, and joint targets that servos did not receive.

    The score of a delay is the delay divided by a threshold and by the time constant with which the standing robot
    would topple.
    """
    if delay_steps := record.sampled.action_delay + _observation_delay_steps(record):
        delay = delay_steps * record.episodes.dt
        description = f"readings and actions are {1000 * delay_steps * record.episodes.dt:.0f} ms late together"
        score = delay / record.time_constant / record.threshold("delay")
        yield Event(SIGNAL, record.window.start, score, description)
    yield from _dropouts(record)


def _dropouts(record: EpisodeSignals) -> Iterator[Event]:
    """Find servos that received no joint targets for some time (dropout) before the failure began.

    A servo holds its last target during a dropout. The score is the largest difference, in rad, between the targets
    that the policy sent during the dropout and the held target, divided by its threshold.
    """
    window = record.window
    dt = record.episodes.dt
    action_delay = record.sampled.action_delay
    dropouts = record.scenario.dropouts
    length = control_steps(dropouts.duration if dropouts else 0.0, dt)
    plan = record.sampled.dropouts
    for start, joint in [] if plan is None else np.transpose(plan).tolist():
        end = min(start + length, window.stop)
        if action_delay < start < window.stop and start + length > window.start - record.steps("look back"):
            sent = record.signal("action")[:, joint]
            missed = float(
                np.abs(sent[start - action_delay : end - action_delay] - sent[start - action_delay - 1]).max()
            )
            description = f"{_joint_name(record, joint)} receives no targets for {(end - start) * dt:.2f} s"
            description += f", {missed:.2f} rad off"
            yield Event(SIGNAL, start, missed / record.threshold("held"), description, is_instantaneous=True)


RULES = (trips, trunk_blow, slides, pushes, motor_saturation, limits, estimation_error, delay_or_dropout)
"""Rules that search for the cause if the robot fell; the events of all of these rules are compared."""
UPRIGHT_RULES = (motor_saturation, slides, estimation_error, delay_or_dropout, limits)
"""Rules that search for the cause of a failure in which the robot stayed upright, by priority.

The first rule that yields an event with a score of at least 1 determines the cause.
"""


def _can_rise(record: EpisodeSignals) -> bool:
    """Return True if the terrain of the episode can have steps or bumps: neither flat nor a plane slope."""
    return not isinstance(record.scenario.terrain, Flat | Slope)


def _leg_name(record: EpisodeSignals, leg: int) -> str:
    """Return the name of a leg in words, for example `front left`.

    Args:
        record: Signals of the failed episode, with the robot.
        leg: Index of the leg in the order FL, FR, RL, RR.

    Returns:
        The name of the leg.
    """
    robot = record.episodes.robot
    end = "front" if robot.hip_positions[leg, 0] > 0.0 else "hind"
    side = "left" if robot.side[leg] > 0.0 else "right"
    return f"{end} {side}"


def _joint_name(record: EpisodeSignals, joint: int) -> str:
    """Return the name of a joint in words, for example `front left thigh`.

    Args:
        record: Signals of the failed episode, with the robot.
        joint: Index of the joint, 0 … 11: three joints (hip, thigh, calf) for each leg in the order FL, FR, RL, RR.

    Returns:
        The name of the joint.
    """
    return f"{_leg_name(record, joint // 3)} {('hip', 'thigh', 'calf')[joint % 3]}"


def _rise_text(record: EpisodeSignals, height: float) -> str:
    """Describe an obstacle in words, for example `the edge of a step (0.15 m)`.

    Args:
        record: Signals of the failed episode; the terrain of its scenario determines the noun.
        height: Height of the obstacle, m.

    Returns:
        The description.
    """
    obstacle = "the edge of a step" if isinstance(record.scenario.terrain, Stairs) else "a rise"
    return f"{obstacle} ({height:.2f} m)"


def _observation_delay_steps(record: EpisodeSignals) -> int:
    """Return the delay of the observations in the episode's scenario, in control steps; 0 for none."""
    latency = record.scenario.latency
    return 0 if latency is None else latency.observation_steps(record.episodes.dt)


def _running_mean(values: Floats | Bools, length: int) -> Floats:
    """Return the mean of a signal over the last `length` control steps, for each control step.

    Args:
        values: Value of the signal in each control step, (steps, …). Values before the first step count as 0.
        length: Number of control steps in each mean: the step itself and the steps before it.

    Returns:
        Mean that ends at each control step, (steps, …), in the unit of `values`.
    """
    sums = np.cumsum(np.concatenate((np.zeros((length, *values.shape[1:])), values)), axis=0)
    return np.asarray((sums[length:] - sums[:-length]) / length)


def _root_mean_square(values: Floats) -> float:
    """Return the root mean square of `values`, (steps,), over the control steps, in their unit."""
    return float(np.sqrt((values**2).mean()))


def _first_step(window: slice, mask: Bools) -> int:
    """Return the index of the first control step in which a condition holds for any foot or joint.

    Args:
        window: Range of control steps.
        mask: True if the condition holds, for each control step of the range and each of k feet or joints, (steps, k).

    Returns:
        Index of the control step, counted from the start of the episode. It is the start of the range if the condition
        never holds.
    """
    return int(window.start + np.argmax(mask.any(axis=1)))
