"""The rules of causes: each looks for one cause in a record and gives the events that may have been it.

What is sudden, such as a blow, has a moment; what lasts, such as ice or noise, begins with the window looked at.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from evaluate.causes.record import SHANK_SAMPLES, EpisodeSignals
from evaluate.measures.averages import Bools, Floats, planar
from evaluate.measures.effort import LIMIT_MARGIN
from quad_env.config import GRAVITY
from quad_env.scenarios.episode import control_steps
from quad_env.scenarios.terrain import Flat, Slope, Stairs

TRIP, SLIP, PUSH, MOTOR, REACH = "trip", "slip", "pushed_over", "motor_limit", "out_of_reach"
ESTIMATE, SIGNAL, GAIT = "wrong_estimate", "late_or_lost_signal", "gait"
SLOW, STALLED, POLICY, UNCLEAR = "too_slow", "stalled", "policy_error", "unclear"
CAUSES = (TRIP, SLIP, PUSH, MOTOR, REACH, ESTIMATE, SIGNAL, GAIT, SLOW, STALLED, POLICY, UNCLEAR)
"""Every cause; a failed episode has exactly one."""
CAUSE_RULE = "causes/1"
"""Name of these rules, written into every manifest."""
TRIP_WINDOW_STEPS, SATURATION_WINDOW_STEPS = 3, 5
"""Control steps over which the speed of a leg before a blow, and a torque at its limit, are means."""


class Event(NamedTuple):
    """Something that can have made an episode fail: its cause, the control step in which it began, what decides by its
    threshold, from 1 on it counts, and its words."""

    cause: str
    step: int
    score: float
    description: str
    is_instantaneous: bool = False


def trips(record: EpisodeSignals, window: slice | None = None) -> Iterator[Event]:
    """Swinging legs that lose speed where the ground rises before them: of each step the strongest blow."""
    window = window or record.window
    steps = np.arange(max(window.start, TRIP_WINDOW_STEPS), min(window.stop, record.end - 1))
    if not _rises(record) or not len(steps):
        return
    (points, velocity), contact = record.shank, record.of("foot_contact") > 0
    before = _running_mean(velocity[..., :2], TRIP_WINDOW_STEPS)[steps - 1]
    after = (velocity[steps, ..., :2] + velocity[steps + 1, ..., :2]) / 2
    speed = planar(before)
    way = before / np.maximum(speed, 1e-9)[..., None]
    ahead = record.threshold("reach of a riser") * way
    rise = record.ground(points[steps, ..., :2] + ahead) - record.ground(points[steps, ..., :2] - ahead)
    touching = np.repeat(contact[steps, :, None], len(SHANK_SAMPLES), axis=2)
    touching[..., :-1] = record.of("leg_contact")[steps, None, None] > 0
    touching &= _running_mean(~contact, TRIP_WINDOW_STEPS)[steps - 1, :, None] > 0
    lost = speed - (after * way).sum(axis=-1)
    score = np.minimum(rise / record.threshold("rise"), lost / record.threshold("speed lost")) * touching
    for row in np.flatnonzero(score.max(axis=(1, 2)) >= 0.5):
        leg, place = np.unravel_index(score[row].argmax(), score[row].shape)
        at, part = (row, leg, place), "foot" if place == len(SHANK_SAMPLES) - 1 else "shin"
        words = f"{_leg(record, int(leg))} {part} hits {_rise(record, float(rise[at]))} at {speed[at]:.1f} m/s"
        yield Event(TRIP, int(steps[row]), float(score[at]), words, is_instantaneous=True)


def trunk_blow(record: EpisodeSignals) -> Iterator[Event]:
    """The trunk that meets ground which rises before it, in an ordinary posture."""
    last, seen = record.end - 1, record.episodes
    usual = record.of("tilt")[last] <= 2 * record.threshold("tilt") and record.onset >= last - record.steps("look back")
    if _rises(record) and usual and seen.fall_reason[record.number] == "trunk_contact":
        x, y, z = seen.robot.trunk_size / 2 + record.threshold("reach of a riser") * np.array([1.0, 1.0, 0.0])
        corners = np.array([(x, y, -z), (x, -y, -z), (-x, y, -z), (-x, -y, -z)]) @ record.rotation[last].T
        feet = record.ground(record.of("foot_position")[last])
        rise = float((record.ground(record.of("position")[last] + corners)).max() - feet.min())
        words = f"the trunk meets {_rise(record, rise)}"
        yield Event(TRIP, record.end, rise / record.threshold("trunk's rise"), words, is_instantaneous=True)


def slides(record: EpisodeSignals) -> Iterator[Event]:
    """Standing feet that slide; on ground that grips they have been driven to it."""
    window, held, friction = record.window, record.of("foot_contact") > 0, record.sampled.friction
    held[1:] &= held[:-1].copy()
    speed = planar(record.shank[1][window, :, -1])
    sliding = held[window] & (speed > record.threshold("slide"))
    if sliding.any():
        share = sliding.sum() / held[window].sum()
        words = f"{share:.0%} of the standing feet slide, at {speed[sliding].mean():.1f} m/s, friction {friction:g}"
        score = share / record.threshold("sliding") * min(1.0, record.threshold("grip") / friction)
        yield Event(SLIP, _first(window, sliding), float(score), words)


def pushes(record: EpisodeSignals) -> Iterator[Event]:
    """Pushes shortly before the onset, by how far they move the capture point; a steady force that it gives way to."""
    seen, force = record.episodes, record.sampled.force
    latest = min(record.onset + seen.push_steps, record.end - 1)
    for step, impulse in zip(seen.push_step[record.number].tolist(), seen.push_impulse[record.number], strict=True):
        if record.fell and record.onset - record.steps("push before") <= step <= latest:
            size = float(np.hypot(*impulse))
            faster = size * GRAVITY / seen.weight
            words = f"a push of {size:.0f} N·s, {faster:.1f} m/s for its mass"
            yield Event(
                PUSH, step, faster * record.time_constant / record.threshold("push"), words, is_instantaneous=True
            )
    if record.fell and force is not None:
        size, step = float(np.hypot(*force)), max(record.onset - 1, 0)
        went = record.capture_point_offset[step:].mean(axis=0)
        if went @ force > 0.5 * size * np.hypot(*went):
            words = f"a steady force of {size:.0f} N, {size / seen.weight:.2f} of the weight"
            yield Event(PUSH, step, size / seen.weight / record.threshold("force"), words)


def motor_saturation(record: EpisodeSignals) -> Iterator[Event]:
    """Motors that stay at their limit of torque, or of speed where they have a torque-speed curve, or servos of limited
    bandwidth far behind their targets."""
    window, bandwidth, seen = record.window, record.scenario.motors.bandwidth, record.episodes
    limit = np.broadcast_to(seen.torque_limit, seen.joint_torque.shape[-1:])
    full = np.abs(
        _running_mean(record.of("joint_torque") / limit, SATURATION_WINDOW_STEPS)[window]
    ) >= record.threshold("saturated")
    if np.isfinite(seen.joule_heat[0, record.number]).all():  # of motors with a curve
        full |= (record.of("peak_speed") / seen.speed_limit)[window] >= record.threshold("saturated")
    weakest = int(full.sum(axis=0).argmax())
    share = full[:, weakest].mean()
    words = f"{_joint(record, weakest)} motor is {share:.0%} of the time at its limit, {limit[weakest]:.3g} N·m"
    yield Event(MOTOR, _first(window, full), float(full.mean()) / record.threshold("saturated joints"), words)
    if bandwidth is not None:
        behind = float(np.abs(record.of("action") - record.of("joint_position"))[window].max(axis=1).mean())
        words = f"servos of {bandwidth:g} Hz are {behind:.2f} rad behind"
        yield Event(MOTOR, window.start, behind / record.threshold("lag"), words)


def limits(record: EpisodeSignals) -> Iterator[Event]:
    """Standing legs at a joint limit, or stretched; targets beyond a limit are usual in crouching gaits."""
    window, robot, joints = record.window, record.episodes.robot, record.of("joint_position")
    beyond = (joints <= robot.joint_lower + LIMIT_MARGIN) | (joints >= robot.joint_upper - LIMIT_MARGIN)
    upper, lower = robot.thigh_length, robot.calf_length
    length = np.sqrt(upper**2 + lower**2 + 2 * upper * lower * np.cos(joints[:, 2::3])) / (upper + lower)
    standing = (record.of("foot_contact") > 0)[window]
    legs = beyond.reshape(*length.shape, -1).any(axis=-1) | (length >= record.threshold("stretched"))
    if (at_limit := legs[window] & standing).any():
        share = float(at_limit.sum() / standing.sum())
        words = f"standing legs are {share:.0%} of the time at the limit of a joint, or stretched"
        yield Event(REACH, _first(window, at_limit), share / record.threshold("at limits"), words)


def estimation_error(record: EpisodeSignals) -> Iterator[Event]:
    """What the policy was shown against the truth of the moment that it was of, by the known delay."""
    if record.episodes.observed is None:
        return
    moments = np.maximum(np.arange(record.end) - _late(record), 0)
    shown, rotation = record.of("observed"), record.rotation[moments]
    down = shown[:, :3] / np.maximum(np.linalg.norm(shown[:, :3], axis=1), 1e-9)[:, None]
    tilt = np.arccos(np.clip(-(down * rotation[:, 2]).sum(axis=1), -1.0, 1.0))
    velocity = planar((rotation @ shown[:, 6:9, None])[:, :2, 0] - record.velocity[moments])
    wrong, off = (float(np.sqrt((each[record.window] ** 2).mean())) for each in (tilt, velocity))
    score = max(wrong / record.threshold("tilt estimate"), off / record.threshold("velocity estimate"))
    words = f"the policy is shown a tilt that is {wrong:.2f} rad wrong, a velocity {off:.2f} m/s"
    yield Event(ESTIMATE, record.window.start, score, words)


def delay_or_dropout(record: EpisodeSignals) -> Iterator[Event]:
    """Delay of readings and actions; servos that receive no targets shortly before the onset."""
    dropouts, plan, window, dt = record.scenario.dropouts, record.sampled.dropouts, record.window, record.episodes.dt
    late, length = record.sampled.action_delay, control_steps(dropouts.duration if dropouts else 0.0, dt)
    if both := late + _late(record):
        words = f"readings and actions are {1000 * both * dt:.0f} ms late together"
        yield Event(SIGNAL, window.start, both * dt / record.time_constant / record.threshold("delay"), words)
    for start, joint in [] if plan is None else np.transpose(plan).tolist():
        end = min(start + length, window.stop)
        if late < start < window.stop and start + length > window.start - record.steps("look back"):
            sent = record.of("action")[:, joint]
            missed = float(np.abs(sent[start - late : end - late] - sent[start - late - 1]).max())
            words = f"{_joint(record, joint)} receives no targets for {(end - start) * dt:.2f} s, {missed:.2f} rad off"
            yield Event(SIGNAL, start, missed / record.threshold("held"), words, is_instantaneous=True)


RULES = (trips, trunk_blow, slides, pushes, motor_saturation, limits, estimation_error, delay_or_dropout)
"""Every rule of a fall."""
UPRIGHT_RULES = (motor_saturation, slides, estimation_error, delay_or_dropout, limits)
"""Those of an upright failure: the first that counts decides."""


def _rises(record: EpisodeSignals) -> bool:
    """Whether there is ground that can rise before a foot."""
    return not isinstance(record.scenario.terrain, Flat | Slope)


def _leg(record: EpisodeSignals, leg: int) -> str:
    robot = record.episodes.robot
    end, side = "front" if robot.hip_positions[leg, 0] > 0.0 else "hind", "left" if robot.side[leg] > 0.0 else "right"
    return f"{end} {side}"


def _joint(record: EpisodeSignals, joint: int) -> str:
    return f"{_leg(record, joint // 3)} {('hip', 'thigh', 'calf')[joint % 3]}"


def _rise(record: EpisodeSignals, height: float) -> str:
    return f"{'the edge of a step' if isinstance(record.scenario.terrain, Stairs) else 'a rise'} ({height:.2f} m)"


def _late(record: EpisodeSignals) -> int:
    """Control steps of the scenario's delay of observations."""
    latency = record.scenario.latency
    return 0 if latency is None else round(latency.observation / record.episodes.dt)


def _running_mean(values: Floats | Bools, length: int) -> Floats:
    """Mean of the last so many rows, (rows, …)."""
    sums = np.cumsum(np.concatenate((np.zeros((length, *values.shape[1:])), values)), axis=0)
    return np.asarray((sums[length:] - sums[:-length]) / length)


def _first(window: slice, holds: Bools) -> int:
    """First step of a window in which any of a row, (steps, k), holds; its start where none ever does."""
    return int(window.start + np.argmax(holds.any(axis=1)))
