"""The rules of causes: each looks for one cause in a record and gives the events that may have been it.

What is sudden, such as a blow, has a moment; what lasts, such as ice or noise, begins with the window looked at.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from evaluate.causes.record import SHANK, Record
from evaluate.measures.averages import Bools, Floats, planar
from evaluate.measures.effort import LIMIT_MARGIN
from quad_env.config import GRAVITY
from quad_env.scenarios.episode import control_steps
from quad_env.scenarios.terrain import Flat, Slope

TRIP, SLIP, PUSH, MOTOR, REACH = "trip", "slip", "pushed_over", "motor_limit", "out_of_reach"
ESTIMATE, SIGNAL, GAIT = "wrong_estimate", "late_or_lost_signal", "gait"
SLOW, STALLED, POLICY, UNCLEAR = "too_slow", "stalled", "policy_error", "unclear"
CAUSES = (TRIP, SLIP, PUSH, MOTOR, REACH, ESTIMATE, SIGNAL, GAIT, SLOW, STALLED, POLICY, UNCLEAR)
"""Every cause; a failed episode has exactly one."""
CAUSE_RULE = "causes/1"
"""Name of these rules, written into every manifest."""
LEGS = {"fl": "front left", "fr": "front right", "hl": "hind left", "hr": "hind right"}
SWING, LASTING = 3, 5
"""Control steps over which the speed of a leg before a blow, and a torque at its limit, are means."""


@dataclass(frozen=True)
class Event:
    """Something that can have made an episode fail."""

    cause: str
    step: int
    """Control step in which it began."""
    strength: float
    """What decided, by its threshold: from 1 on it counts."""
    words: str
    sudden: bool = False


def trips(record: Record, window: slice | None = None) -> Iterator[Event]:
    """Swinging legs that lose speed where the ground rises before them: of each step the strongest blow."""
    window = window or record.window
    first, last = max(window.start, SWING), window.stop
    if isinstance(record.scenario.terrain, Flat | Slope) or first >= last:
        return  # where nothing rises before a foot
    (points, velocity), contact = record.shank, record.of("foot_contact") > 0
    before = _running_mean(velocity[..., :2], SWING)[first - 1 : last - 1]
    after = (velocity[first:last, ..., :2] + velocity[np.arange(first, last).clip(max=last - 2) + 1, ..., :2]) / 2
    speed = planar(before)
    way = before / np.maximum(speed, 1e-9)[..., None]
    ahead = record.at("reach of a riser") * way
    rise = record.ground(points[first:last, ..., :2] + ahead) - record.ground(points[first:last, ..., :2] - ahead)
    lost = speed - (after * way).sum(axis=-1)
    touching = np.repeat(contact[first:last, :, None], len(SHANK), axis=2)
    touching[..., :-1] = record.of("leg_contact")[first:last, None, None] > 0
    touching &= _running_mean(~contact, SWING)[first - 1 : last - 1, :, None] > 0
    strength = np.minimum(rise / record.at("rise"), lost / record.at("speed lost")) * touching
    for step in np.flatnonzero(strength.max(axis=(1, 2)) >= 0.5):
        leg, place = np.unravel_index(strength[step].argmax(), strength[step].shape)
        at, name = (step, leg, place), record.episodes.robot.leg_names[leg]
        part = f"{LEGS.get(name, name)} {'foot' if place == len(SHANK) - 1 else 'shin'}"
        words = f"{part} hits a rise of {rise[at]:.2f} m at {speed[at]:.1f} m/s"
        yield Event(TRIP, first + int(step), float(strength[at]), words, sudden=True)


def trunk_blow(record: Record) -> Iterator[Event]:
    """The trunk that meets ground which rises before it, in an ordinary posture."""
    last, robot = record.end - 1, record.episodes.robot
    usual = record.of("tilt")[last] <= 2 * record.at("tilt") and record.onset >= last - record.steps("look back")
    if not usual or record.episodes.fall_reason[record.number] != "trunk_contact":
        return
    x, y, z = robot.trunk_size / 2 + record.at("reach of a riser") * np.array([1.0, 1.0, 0.0])
    corners = np.array([(x, y, -z), (x, -y, -z), (-x, y, -z), (-x, -y, -z)]) @ record.rotation[last].T
    ground = record.ground(record.of("position")[last] + corners)
    rise = float(ground.max() - record.ground(record.of("foot_position")[last]).min())
    if not isinstance(record.scenario.terrain, Flat | Slope):
        words = f"the trunk meets a rise of {rise:.2f} m"
        yield Event(TRIP, record.end, rise / record.at("trunk's rise"), words, sudden=True)


def slides(record: Record) -> Iterator[Event]:
    """Standing feet that slide; on ground that grips they have been driven to it."""
    window, held, friction = record.window, record.of("foot_contact") > 0, record.scenario.ground.friction
    held[1:] &= held[:-1].copy()
    speed = planar(record.shank[1][window, :, -1])
    sliding = held[window] & (speed > record.at("slide"))
    if sliding.any():
        share = sliding.sum() / held[window].sum()
        words = f"{share:.0%} of the standing feet slide, at {speed[sliding].mean():.1f} m/s, friction {friction:g}"
        strength = share / record.at("sliding") * min(1.0, record.at("grip") / friction)
        yield Event(SLIP, _first(window, sliding), float(strength), words)


def pushes(record: Record) -> Iterator[Event]:
    """Pushes shortly before the onset, by how far they move the capture point."""
    steps, impulses = record.episodes.push_step[record.number], record.episodes.push_impulse[record.number]
    latest = min(record.onset + record.episodes.push_steps, record.end - 1)
    for step, impulse in zip(steps.tolist(), impulses, strict=True):
        if record.fell and record.onset - record.steps("push before") <= step <= latest:
            size = float(np.hypot(*impulse))
            faster = size * GRAVITY / record.episodes.weight
            words = f"a push of {size:.0f} N·s, {faster:.1f} m/s"
            yield Event(PUSH, step, faster * record.time_constant / record.at("push"), words, sudden=True)


def forces(record: Record) -> Iterator[Event]:
    """A steady force, where the robot gives way to it."""
    if (force := record.drawn.force) is None or not record.fell:
        return
    size, step = float(np.hypot(*force)), max(record.onset - 1, 0)
    went = record.capture[step:].mean(axis=0)
    share = size / record.episodes.weight
    if went @ force > 0.5 * size * np.hypot(*went):
        words = f"a steady force of {size:.0f} N, {share:.2f} of the weight"
        yield Event(PUSH, step, share / record.at("force"), words)


def motors(record: Record) -> Iterator[Event]:
    """Motors that stay at their limit of torque, or of speed where they have a torque-speed curve, or servos of limited
    bandwidth far behind their targets."""
    window, bandwidth = record.window, record.scenario.motors.bandwidth
    limit = np.broadcast_to(record.episodes.torque_limit, record.episodes.joint_torque.shape[-1:])
    share = _running_mean(record.of("joint_torque") / limit, LASTING)[window]
    full = np.abs(share) >= record.at("saturated")
    if np.isfinite(record.episodes.joule_heat[0, record.number]).all():  # of motors with a curve
        full |= (record.of("peak_speed") / record.episodes.speed_limit)[window] >= record.at("saturated")
    weakest = int(full.sum(axis=0).argmax())
    name = record.episodes.robot.joint_names[weakest]
    words = f"{name} is {full[:, weakest].mean():.0%} of the time at its limit, {limit[weakest]:.3g} N·m"
    step = _first(window, full)
    yield Event(MOTOR, step, float(full.mean()) / record.at("saturated joints"), words)
    if bandwidth is not None:
        behind = float(np.abs(record.of("action") - record.of("joint_position"))[window].max(axis=1).mean())
        words = f"servos of {bandwidth:g} Hz are {behind:.2f} rad behind"
        yield Event(MOTOR, window.start, behind / record.at("lag"), words)


def limits(record: Record) -> Iterator[Event]:
    """Standing legs at a joint limit, or stretched; targets beyond a limit are usual in crouching gaits."""
    window, robot, joints = record.window, record.episodes.robot, record.of("joint_position")
    beyond = (joints <= robot.joint_lower + LIMIT_MARGIN) | (joints >= robot.joint_upper - LIMIT_MARGIN)
    upper, lower, bent = robot.thigh_length, robot.calf_length, np.cos(joints[:, 2::3])
    length = np.sqrt(upper**2 + lower**2 + 2 * upper * lower * bent) / (upper + lower)
    standing = (record.of("foot_contact") > 0)[window]
    legs = beyond.reshape(*length.shape, -1).any(axis=-1) | (length >= record.at("stretched"))
    if (at_limit := legs[window] & standing).any():
        share = float(at_limit.sum() / standing.sum())
        words = f"standing legs are {share:.0%} of the time at the limit of a joint, or stretched"
        yield Event(REACH, _first(window, at_limit), share / record.at("at limits"), words)


def estimates(record: Record) -> Iterator[Event]:
    """What the policy was shown against the truth of the moment that it was of, by the known delay."""
    if record.episodes.observed is None:
        return
    moments = np.maximum(np.arange(record.end) - _late(record, "observation"), 0)
    shown, rotation = record.of("observed"), record.rotation[moments]
    down = shown[:, :3] / np.maximum(np.linalg.norm(shown[:, :3], axis=1), 1e-9)[:, None]
    tilt = np.arccos(np.clip(-(down * rotation[:, 2]).sum(axis=1), -1.0, 1.0))
    off = planar((rotation @ shown[:, 6:9, None])[:, :2, 0] - record.velocity[moments])
    errors = [float(np.sqrt((each[record.window] ** 2).mean())) for each in (tilt, off)]
    strength = max(errors[0] / record.at("tilt estimate"), errors[1] / record.at("velocity estimate"))
    words = f"the policy is shown a tilt that is {errors[0]:.2f} rad wrong, a velocity {errors[1]:.2f} m/s"
    yield Event(ESTIMATE, record.window.start, strength, words)


def signals(record: Record) -> Iterator[Event]:
    """Delay of readings and actions; servos that receive no targets shortly before the onset."""
    plan, window, dt = record.drawn.dropouts, record.window, record.episodes.dt
    if late := _late(record, "action") + _late(record, "observation"):
        words = f"readings and actions are {1000 * late * dt:.0f} ms late together"
        yield Event(SIGNAL, window.start, late * dt / record.time_constant / record.at("delay"), words)
    if plan is None or record.scenario.dropouts is None:
        return
    length, late = control_steps(record.scenario.dropouts.duration, dt), _late(record, "action")
    for start, joint in np.transpose(plan).tolist():
        end = min(start + length, window.stop)
        if late < start < window.stop and start + length > window.start - record.steps("look back"):
            sent, name = record.of("action")[:, joint], record.episodes.robot.joint_names[joint]
            missed = float(np.abs(sent[start - late : end - late] - sent[start - late - 1]).max())
            words = f"{name} receives no targets for {(end - start) * dt:.2f} s, {missed:.2f} rad off"
            yield Event(SIGNAL, start, missed / record.at("held"), words, sudden=True)


RULES = (trips, trunk_blow, slides, pushes, forces, motors, limits, estimates, signals)
"""Every rule of a fall."""
UPRIGHT_RULES = (motors, slides, estimates, signals, limits)
"""Those of an upright failure: the first that counts decides."""


def _late(record: Record, of: str) -> int:
    """Control steps of the scenario's delay of `action` or `observation`."""
    latency = record.scenario.latency
    return 0 if latency is None else round(getattr(latency, of) / record.episodes.dt)


def _running_mean(values: Floats | Bools, length: int) -> Floats:
    """Mean of the last so many rows, (rows, …)."""
    sums = np.cumsum(np.concatenate((np.zeros((length, *values.shape[1:])), values)), axis=0)
    return np.asarray((sums[length:] - sums[:-length]) / length)


def _first(window: slice, holds: Bools) -> int:
    """First step of a window in which any of a row, (steps, k), holds; its start where none ever does."""
    return int(window.start + np.argmax(holds.any(axis=1)))
