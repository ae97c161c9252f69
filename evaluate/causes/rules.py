"""The rules of causes: each looks for one cause in a record and gives what began it, or nothing.

What is sudden, a blow or a lost signal, has a moment; what lasts, such as ice or noise, begins with the window.
"""

from dataclasses import dataclass

import numpy as np

from evaluate.causes.record import Record
from evaluate.causes.thresholds import at
from evaluate.measures.averages import Bools, Floats, planar
from evaluate.measures.effort import LIMIT_MARGIN
from quad_env.config import GRAVITY
from quad_env.scenarios.episode import control_steps
from quad_env.scenarios.terrain import Slope

TRIP, SLIP, PUSH, MOTOR, REACH = "trip", "slip", "pushed_over", "motor_limit", "out_of_reach"
ESTIMATE, SIGNAL, GAIT = "wrong_estimate", "late_or_lost_signal", "gait"
SLOW, STALLED, POLICY, UNCLEAR = "too_slow", "stalled", "policy_error", "unclear"
CAUSES = (TRIP, SLIP, PUSH, MOTOR, REACH, ESTIMATE, SIGNAL, GAIT, SLOW, STALLED, POLICY, UNCLEAR)
"""Every cause; a failed episode has exactly one."""
CAUSE_RULE = "causes/1"
"""Name of these rules, written into every manifest."""
LEGS = {"fl": "front left", "fr": "front right", "hl": "hind left", "hr": "hind right"}


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


def leg(record: Record, number: int) -> str:
    """A leg in words."""
    name = record.episodes.robot.leg_names[number]
    return LEGS.get(name, name)


def trips(record: Record) -> list[Event]:
    """Feet and shins that lose speed where the ground rises before them."""
    if isinstance(record.scenario.terrain, Slope):
        return []  # on which nothing rises before a foot
    (points, velocity), window = record.shank, record.window
    first = max(window.start, 3)
    touching = np.repeat(record.of("foot_contact")[:, :, None] > 0, points.shape[2], axis=2)
    touching[:, :, :-1] = record.of("leg_contact")[:, None, None] > 0
    swung = ~(record.of("foot_contact") > 0)
    found = []
    for step in range(first, window.stop):
        before = velocity[step - 3 : step, ..., :2].mean(axis=0)
        speed = planar(before)
        way = before / np.maximum(speed, 1e-9)[..., None]
        lost = speed - (velocity[step : step + 2, ..., :2].mean(axis=0) * way).sum(axis=-1)
        about = record.its("reach of a riser") * way
        rise = record.ground(points[step, ..., :2] + about) - record.ground(points[step, ..., :2] - about)
        strength = np.minimum(rise / record.its("rise"), lost / record.its("speed lost"))
        strength = np.where(touching[step] & swung[step - 3 : step].any(axis=0)[:, None], strength, 0.0)
        foot, place = np.unravel_index(strength.argmax(), strength.shape)
        if strength[foot, place] >= 0.5:
            part = "foot" if place == points.shape[2] - 1 else "shin"
            words = f"{leg(record, int(foot))} {part} hits a rise of {rise[foot, place]:.2f} m at {speed[foot, place]:.1f} m/s"
            found.append(Event(TRIP, step, float(strength[foot, place]), words, sudden=True))
    return found


def trunk_blow(record: Record) -> list[Event]:
    """The trunk that meets ground which rises before it, in an ordinary posture."""
    if record.episodes.fall_reason[record.number] != "trunk_contact" or record.end < 3 or not record.fell:
        return []
    last = record.end - 1
    half = np.array(record.episodes.robot.trunk_size) / 2
    ahead = half + (record.its("reach of a riser"), record.its("reach of a riser"), 0.0)
    corners = np.array([(x, y, -half[2]) for x in (-ahead[0], ahead[0]) for y in (-ahead[1], ahead[1])])
    place = record.of("position")[last] + corners @ record.rotation[last].T
    rise = (record.ground(place) - record.ground(record.of("foot_position")[last]).min()).max()
    usual = record.of("tilt")[last] <= 2 * record.its("tilt") and record.onset >= last - record.steps("look back")
    strength = rise / (2 * record.its("rise")) if usual and not isinstance(record.scenario.terrain, Slope) else 0.0
    return [Event(TRIP, record.end, float(strength), f"the trunk meets a rise of {rise:.2f} m", sudden=True)]


def slides(record: Record) -> list[Event]:
    """Standing feet that slide."""
    window, held = record.window, record.of("foot_contact") > 0
    held[1:] &= held[:-1].copy()
    speed = np.where(held, planar(record.shank[1][:, :, -1]), 0.0)[window]
    sliding = speed > record.its("slide")
    if not (standing := held[window].sum()):
        return []
    friction = record.scenario.ground.friction
    strength = float(sliding.sum() / standing) / at("sliding") * min(1.0, at("grip") / friction)
    speed_of_them = speed[sliding].mean() if sliding.any() else 0.0
    words = f"{sliding.sum() / standing:.0%} of the standing feet slide, at {speed_of_them:.1f} m/s, friction {friction:g}"
    return [Event(SLIP, _first(window, sliding.any(axis=1)), strength, words)]


def pushes(record: Record) -> list[Event]:
    """Pushes shortly before the onset, by how far they move the capture point."""
    found = []
    mass = record.episodes.weight / GRAVITY
    steps, impulses = record.episodes.push_step[record.number], record.episodes.push_impulse[record.number]
    for step, impulse in zip(steps.tolist(), impulses, strict=True):
        lately = step <= record.onset + record.episodes.push_steps and record.onset - step <= record.steps("push before")
        if lately and step < record.end and record.fell:
            faster = float(np.hypot(*impulse)) / mass
            words = f"a push of {np.hypot(*impulse):.0f} N·s, {faster:.1f} m/s"
            found.append(Event(PUSH, step, faster * record.time_constant / record.its("push"), words, sudden=True))
    return found


def forces(record: Record) -> list[Event]:
    """A steady force, where the robot gives way to it."""
    if (force := record.drawn.force) is None or not record.fell:
        return []
    size = float(np.hypot(*force))
    last = record.capture[max(record.onset - 1, 0) :].mean(axis=0)
    along = float(last @ force) / max(float(np.hypot(*last)) * size, 1e-9)
    share = size / record.episodes.weight
    words = f"a steady force of {size:.0f} N, {share:.2f} of the weight"
    return [Event(PUSH, max(record.onset - 1, 0), share / at("force") * (along > 0.5), words)]


def motors(record: Record) -> list[Event]:
    """Motors at their limit of torque for 50 ms on end, or servos of limited bandwidth far behind their targets."""
    window, limit = record.window, np.broadcast_to(record.episodes.torque_limit, record.of("joint_torque").shape[1:])
    share = _running_mean(record.of("joint_torque") / limit, 5)
    full = np.abs(share[window]) >= at("saturated")
    joints, weakest = float(full.mean()), int(full.mean(axis=0).argmax())
    words = f"{full[:, weakest].mean():.0%} of the time {record.episodes.robot.joint_names[weakest]} is at {limit[weakest]:.3g} N·m"
    found = [Event(MOTOR, _first(window, full.any(axis=1)), joints / at("saturated joints"), words)]
    if (bandwidth := record.scenario.motors.bandwidth) is not None:
        behind = np.abs(record.of("action") - record.of("joint_position"))[window].max(axis=1).mean()
        words = f"servos of {bandwidth:g} Hz are {behind:.2f} rad behind"
        found.append(Event(MOTOR, window.start, float(behind) / at("lag"), words))
    return found


def limits(record: Record) -> list[Event]:
    """Standing legs at a joint limit, or asked beyond one, or stretched."""
    window, robot = record.window, record.episodes.robot
    low, high = robot.joint_lower + LIMIT_MARGIN, robot.joint_upper - LIMIT_MARGIN
    joints = [record.of(name) for name in ("joint_position", "action")]
    beyond = np.any([(each <= low) | (each >= high) for each in joints], axis=0)
    legs = beyond.reshape(record.end, len(robot.leg_names), -1).any(axis=-1)
    upper, lower, knee = robot.thigh_length, robot.calf_length, joints[0].reshape(*legs.shape, -1)[..., 2]
    length = np.sqrt(upper**2 + lower**2 + 2 * upper * lower * np.cos(knee)) / (upper + lower)
    standing = (record.of("foot_contact") > 0)[window]
    at_limit = (legs | (length >= at("stretched")))[window] & standing
    if not standing.any():
        return []
    strength = float(at_limit.sum() / standing.sum()) / at("at limits")
    words = f"standing legs are {at_limit.sum() / standing.sum():.0%} of the time at a limit of a joint or stretched"
    return [Event(REACH, _first(window, at_limit.any(axis=1)), strength, words)]


def estimates(record: Record) -> list[Event]:
    """What the policy was shown against the truth of the same moment, that of the known delay."""
    if record.episodes.observed is None:
        return []
    late = 0 if record.scenario.latency is None else record.late(record.scenario.latency.observation)
    moments = np.maximum(np.arange(record.end) - late, 0)
    shown, rotation = record.of("observed"), record.rotation[moments]
    down = shown[:, :3] / np.maximum(np.linalg.norm(shown[:, :3], axis=1), 1e-9)[:, None]
    tilt = np.arccos(np.clip(-(down * rotation[:, 2]).sum(axis=1), -1.0, 1.0))
    moving = (rotation @ shown[:, 6:9, None])[:, :2, 0]
    off = planar(moving - record.in_world(record.of("heading_velocity"))[moments])
    errors = [float(np.sqrt((each[record.window] ** 2).mean())) for each in (tilt, off)]
    strength = max(errors[0] / at("tilt estimate"), errors[1] / record.its("velocity estimate"))
    words = f"the policy is shown a tilt that is {errors[0]:.2f} rad wrong, a velocity {errors[1]:.2f} m/s"
    return [Event(ESTIMATE, record.window.start, strength, words)]


def signals(record: Record) -> list[Event]:
    """Delay of readings and actions; servos that receive no targets shortly before the onset."""
    found, latency = [], record.scenario.latency
    if latency is not None:
        delay = latency.action + latency.observation
        words = f"readings and actions are {1000 * delay:.0f} ms late together"
        strength = delay / record.time_constant / at("delay")
        found.append(Event(SIGNAL, record.window.start, strength, words))
    plan, dropouts = record.drawn.dropouts, record.scenario.dropouts
    if plan is None or dropouts is None or not record.fell:
        return found
    length, late = control_steps(dropouts.duration, record.episodes.dt), 0 if latency is None else record.late(latency.action)
    for start, joint in zip(plan.first_step.tolist(), plan.joint.tolist(), strict=True):
        end = min(start + length, record.window.stop)
        if start >= record.window.stop or start + length <= record.window.start or start <= late:
            continue
        sent = record.of("action")[:, joint]
        missed = np.abs(sent[start - late : end - late] - sent[start - late - 1])
        name = record.episodes.robot.joint_names[joint]
        words = f"{name} receives no targets for {(end - start) * record.episodes.dt:.2f} s, {missed.max():.2f} rad"
        found.append(Event(SIGNAL, start, float(missed.max()) / at("held"), words, sudden=True))
    return found


RULES = (trips, trunk_blow, slides, pushes, forces, motors, limits, estimates, signals)
"""Every rule of a fall."""


def _running_mean(values: Floats, length: int) -> Floats:
    """Mean of the last so many rows, (rows, k)."""
    sums = np.cumsum(np.concatenate((np.zeros((length, *values.shape[1:])), values)), axis=0)
    return np.asarray((sums[length:] - sums[:-length]) / length)


def _first(window: slice, holds: Bools) -> int:
    """First step of a window in which something holds; its start where it never does."""
    return window.start + int(holds.argmax())
