"""A diagonal trot with feedback: footholds by velocity error, legs by attitude and height, the plan by the ground.

The feet are planned in the level frame (see `policies.legs.level_frame`). A standing foot passes under the trunk at the
reference velocity there; a swinging one goes to a foothold that moves with the velocity error until it lands. A robot
that is far too fast for any foothold puts all feet down, wide and low, and slides to rest: it braces. On ground too
steep or too rough to walk on it stands still.
"""

import numpy as np
from numpy.typing import NDArray

from policies.base import CONTROL_PERIOD, Actions, GaitedPolicy, to_actions
from policies.gait_cycle import TROT_OFFSETS, TURN, Floats, LegCycle, places
from policies.legs.foot_path import captured, lift, load, passing, raibert, swung, within_reach
from policies.legs.kinematics import held_up, leg_angles
from policies.legs.level_frame import LevelFrame, Senses, Vector, hips, length, sense
from policies.memory import per_robot, taken_in
from policies.trot.feedback_parameters import FeedbackParameters, searched_parameters
from policies.trot.perception import Following, GroundSense
from quad_env import OBSERVATION, OBSERVATION_SIZE
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

LARGEST_CORRECTION = 0.5
"""Largest correction of the gait's velocity by the integral of its error, m/s and rad/s."""
SMALL_ERROR = 0.3
"""Velocity error, m/s, and yaw-rate error, rad/s, beyond which the integral waits: that is a push, not a bias."""
SETTLED = 0.2
"""Share of its stance after which a foot is taken to stand."""
BRACE_TIME = 0.03
"""From the trot to all feet down, s."""
BRACE_RANGE = 0.4
"""Excess speed from the beginning of bracing to all feet down, m/s."""
RECOVERY_TIME = 0.6
"""From the end of an excess speed, or a jump of the command, until the feet measure the ground again, s."""
STEEP_RANGE = 0.1
"""The same of the ground's slope."""
ROUGH_RANGE = 0.005
"""The same of the ground's roughness, m."""
BRACED_LOAD = 0.5
"""Load of each foot while all four share the weight, per that of a foot of a trotting pair."""
LARGEST_LEAD = 0.1
"""Shift of the feet in bracing, m."""
LARGEST_TILT_ERROR = 0.5
"""Tilt that the legs answer to, rad."""
FELT = np.concatenate(
    [
        np.arange(OBSERVATION_SIZE)[OBSERVATION[name]]
        for name in ("linear_velocity", "angular_velocity", "projected_gravity", "joint_position")
    ]
)
"""Places in the observation of what is smoothed: all readings of sensors."""
SLOWDOWN_RATE = 3.0
"""Change of the slowing down of the gait, as a share of its frequency, a second and missing share of movement, 1/s."""
LARGEST_SLOWDOWN = 0.6
"""Of the gait, as a share of its frequency."""
SHORTEST_DROP = 0.08
"""Least distance of a planned foot below the trunk's centre, m."""


class TrotFeedback(GaitedPolicy):
    """Command-following trot with feedback; steps in place at zero command."""

    name = "trot_feedback"
    brace: Floats = per_robot(0.0)
    """How far all feet are down, 0 … 1, (n,)."""
    hold: Floats = per_robot(0.0)
    """How far that is for rough ground, 0 … 1, (n,)."""
    disturbed: Floats = per_robot(0.0)
    """1 where a robot is too fast, falling to 0 afterwards, (n,)."""
    slowdown: Floats = per_robot(0.0)
    """Of the gait, as a share of its frequency, (n,)."""
    reference: Floats = per_robot(np.zeros(3), axis=1)
    """Velocity to have now, m/s, m/s and rad/s, (3, n)."""
    velocity_correction: Floats = per_robot(np.zeros(3), axis=1)
    """Of the gait's velocity by the integral of its error, (3, n)."""
    feet: Floats = per_robot(lambda policy: policy._neutral[..., 0], axis=2)
    """Planned, level frame, m, (2, 4, n)."""
    lift: Floats = per_robot(np.zeros(4), axis=1)
    """Of the planned feet, m, (4, n)."""
    _start: Floats = per_robot(lambda policy: policy._neutral[..., 0], axis=2)
    _speed: Floats = per_robot(np.zeros((2, 4)), axis=2)
    _swinging: NDArray[np.bool_] = per_robot(np.zeros(4, np.bool_), axis=1)
    _followed: Floats = per_robot(np.zeros(2), axis=1)
    _error: Floats = per_robot(np.zeros(2), axis=1)
    _felt: Floats = per_robot(np.zeros(len(FELT)), axis=1)

    def __init__(
        self,
        parameters: FeedbackParameters | None = None,
        *,
        robot: str | Robot = SIMPLE_QUAD,
        control_period: float = CONTROL_PERIOD,
    ) -> None:
        super().__init__(robot=robot, control_period=control_period)
        robot = self.robot
        self.parameters = p = parameters if parameters is not None else searched_parameters(robot)
        self.frequency = p.frequency
        self.leg_offsets = robot.in_leg_order(TROT_OFFSETS)
        self._offsets = np.array(self.leg_offsets)[:, None]
        self._neutral = np.stack((hips(robot)[0] + p.stance_shift, robot.side[:, None] * (p.stance_width / 2.0)))
        self._wide = _rectangle(robot, p.brace_length, p.brace_width)
        self._hold = _rectangle(robot, p.hold_length, p.hold_width)
        self._acceleration = np.array([[p.linear_acceleration], [p.linear_acceleration], [p.yaw_acceleration]])
        self._integral = np.array([[p.integral_gain], [p.integral_gain], [p.yaw_integral_gain]])
        self.ground = GroundSense(robot, control_period, p.plane_filter)
        self.following = Following(robot.num_joints, control_period)

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        columns = self._smoothed(np.ascontiguousarray(observation.T, dtype=np.float64))
        senses = sense(self.robot, columns)
        command = columns[OBSERVATION["command"]]
        reference = self._reference_velocity(command)
        error = np.stack((*senses.velocity[:2], senses.yaw_rate)) - reference
        errors = (error[0], error[1], error[2])
        excess = length(*senses.velocity[:2]) - length(reference[0], reference[1]) - self.parameters.brace_error
        brace = self._brace(excess)
        pushed = (self.disturbed > 0.0) | ((brace > 0.0) & (self.hold == 0.0))
        undisturbed = ~(pushed | self._lurches(command))
        self._follow(columns[OBSERVATION["joint_position"]], brace)
        self._advance_clock(errors, brace)
        cycle = places((self._phase + self._offsets) % TURN, self.parameters.duty)
        self.ground.update(senses, (~cycle.swing & (cycle.progress > SETTLED)) | (brace > BRACED_LOAD), undisturbed)
        gait = self._gait_velocity(reference, error)
        self._plan_feet(senses.frame, cycle, gait, errors, brace)
        feet = self._foot_targets(senses, cycle, errors, brace)
        weight = np.maximum(load(cycle), brace)
        joints = _joints(self.robot, self._levelled(senses, feet, weight, brace), self._force(cycle, brace))
        targets = self._blended(joints, self.parameters.blend_time)
        self.following.command((targets - self.robot.home_pose).T, 1.0 - brace)
        return to_actions(self.robot, targets)

    def _smoothed(self, columns: Floats) -> Floats:
        """Observations (k, n) whose sensor readings lag by the sensors' filter."""
        now = columns[FELT]
        share = taken_in(self.control_period, self.parameters.sensor_filter)
        former = np.where(self._ticks == 0.0, now, self._felt)
        self._felt = columns[FELT] = former + share * (now - former)
        return columns

    def _follow(self, joints: Floats, brace: Floats) -> None:
        """Slow the gait down while the joints, (12, n), rad, fall short of their targets' movement."""
        self.following.read(joints, 1.0 - brace)
        missing = (self.parameters.least_following - self.following.ratio) * (1.0 - brace)
        slowdown = self.slowdown + (SLOWDOWN_RATE * self.control_period) * missing
        self.slowdown = np.clip(slowdown, 0.0, LARGEST_SLOWDOWN)

    @property
    def _period(self) -> Floats:
        """Of each robot's gait while nothing disturbs it, s, (n,)."""
        return 1.0 / (self.parameters.frequency * (1.0 - self.slowdown))

    def _reference_velocity(self, command: Floats) -> Floats:
        """The velocity to have now, (3, n): the command, less of it on bad ground, approached within the limits."""
        p = self.parameters
        rough, steep = p.rough_slowdown * self.ground.roughness, p.slope_slowdown * self.ground.steepness
        goal = command * (1.0 - self.brace) / (1.0 + rough * rough + steep * steep)
        reach = self.control_period * self._acceleration
        self.reference = self.reference + np.clip(goal - self.reference, -reach, reach)
        return self.reference

    def _lurches(self, command: Floats) -> NDArray[np.bool_]:
        """Whether a jump of the command, (3, n), still throws the robot about, (n,): it is far from the same, lagged.

        The first command of an episode is none.
        """
        planar, followed = command[:2], self._followed
        followed = np.where(self._ticks == 0.0, planar, followed)
        self._followed = followed + (self.control_period / RECOVERY_TIME) * (planar - followed)
        return length(*(planar - self._followed)) > self.parameters.capture_threshold

    def _brace(self, excess: Floats) -> Floats:
        """How far all feet are down, 0 … 1, by the excess speed: quickly on and slowly off; (n,)."""
        p = self.parameters
        steep = np.clip((self.ground.steepness - p.slope_brace) / STEEP_RANGE, 0.0, 1.0)
        rough = np.clip((self.ground.worst_roughness - p.rough_brace) / ROUGH_RANGE, 0.0, 1.0)
        disturbed = np.maximum(self.disturbed - self.control_period / RECOVERY_TIME, 0.0)
        self.disturbed = np.where(excess > 0.0, 1.0, disturbed)
        self.hold = rough * (1.0 - steep) * (1.0 - self.disturbed)
        due = np.maximum(np.clip(excess / BRACE_RANGE, 0.0, 1.0), np.maximum(steep, rough))
        change = np.clip(due - self.brace, -self.control_period / p.brace_release, self.control_period / BRACE_TIME)
        self.brace = self.brace + change
        return self.brace

    def _advance_clock(self, errors: Vector, brace: Floats) -> None:
        """Move the clock on: faster while a push is being caught, not at all while all feet are down."""
        p = self.parameters
        faster = 1.0 + p.frequency_gain * np.clip(length(*errors[:2]) - p.capture_threshold, 0.0, 1.0)
        cycles = self.control_period / self._period * faster * (1.0 - brace)
        self._phase = (self._phase + TURN * cycles) % TURN
        self._ticks = self._ticks + 1.0

    def _gait_velocity(self, reference: Floats, error: Floats) -> Vector:
        """Velocity of the gait: feedforward of the reference and the integral of the small errors."""
        small = (np.abs(error) < SMALL_ERROR).all(axis=0)
        correction = self.velocity_correction - np.where(small, self.control_period * self._integral * error, 0.0)
        self.velocity_correction = np.clip(correction, -LARGEST_CORRECTION, LARGEST_CORRECTION)
        p, (forward, lateral, yaw_rate) = self.parameters, reference
        lead = p.turn_lead * yaw_rate
        more_forward, more_lateral, more_yaw = self.velocity_correction
        return (
            p.forward_gain * (forward - lead * lateral) + p.forward_bias + more_forward,
            p.lateral_gain * (lateral + lead * forward) + more_lateral,
            p.yaw_gain * yaw_rate + p.yaw_per_lateral * lateral + more_yaw,
        )

    def _footholds(self, neutral: Floats, gait: Vector, errors: Vector) -> Floats:
        """Where the swinging feet are to land, by velocity errors smoothed over the sway of a stride."""
        p = self.parameters
        share = taken_in(self.control_period, p.velocity_filter)
        self._error = self._error + share * (np.stack(errors[:2]) - self._error)
        stance_time = p.neutral_share * p.duty * self._period
        gains = (p.raibert_gain, p.raibert_lateral, p.yaw_step)
        feet = raibert(neutral, gait, stance_time, (self._error[0], self._error[1], errors[2]), gains)
        return within_reach(feet + captured(self._error, p.capture_threshold, p.capture_gain)[:, None], neutral)

    def _plan_feet(self, frame: LevelFrame, cycle: LegCycle, gait: Vector, errors: Vector, brace: Floats) -> None:
        """Move the planned feet: the standing ones with the ground, the swinging ones towards their footholds."""
        p = self.parameters
        neutral = self._uphill(_under(frame, self._neutral))
        foothold = self._footholds(neutral, gait, errors)
        feet, error = self.feet, np.stack(errors[:2])[:, None]
        lifted = cycle.swing & ~self._swinging
        self._swinging = cycle.swing
        self._start = np.where(lifted, feet, self._start)
        drift = passing(feet, gait)
        stood = within_reach(feet + self.control_period * (drift - p.stance_yield * error), neutral)
        swing_time = (1.0 - p.duty) * self._period
        planned = np.where(cycle.swing, swung(self._start, foothold, drift * swing_time, cycle.progress), stood)
        wide = self._uphill(_under(frame, self._wide + self.hold * (self._hold - self._wide)))
        wide = wide + np.clip(p.brace_lead * error, -LARGEST_LEAD, LARGEST_LEAD)
        planned = planned + brace * (wide - planned)
        self._speed = (planned - feet) / self.control_period
        self.feet = planned

    def _uphill(self, places: Floats) -> Floats:
        """Level-frame points (2, 4, n) shifted against the fall of the ground."""
        return places + self.parameters.slope_shift * self.ground.slope[:, None]

    def _foot_targets(self, senses: Senses, cycle: LegCycle, errors: Vector, brace: Floats) -> Vector:
        """Feet in the base frame, m: the plan, the lead of the servos, and the standing legs' push against errors."""
        p, ground = self.parameters, self.ground
        x, y = self.feet
        weight = np.maximum(load(cycle), brace)
        low = p.brace_height + self.hold * (p.hold_height - p.brace_height)
        tall = p.body_height + brace * (low - p.body_height)
        tall = tall + p.rough_height * ground.roughness + p.slope_height * ground.steepness
        lengthening = p.height_gain * (tall + ground.height) - p.height_damping * senses.velocity[2]
        high = p.step_height + p.rough_step * ground.roughness + p.slow_step * self.slowdown
        lifted = high * lift(cycle) * (1.0 - brace)
        rising = (lifted - self.lift) / self.control_period
        self.lift = lifted
        shortening = p.terrain_compliance * ground.unevenness - lengthening
        z = ground.slope[0] * x + ground.slope[1] * y - tall + weight * shortening
        x, y = self.feet + p.servo_lead * self._speed
        # Standing feet are pushed along with the error, so that the trunk is pushed against it.
        # Harder than up to the error that a step is to catch, they would kick it off the ground.
        push = weight * (1.0 - brace)
        held = p.stance_push * np.minimum(1.0, p.capture_threshold / np.maximum(length(*errors[:2]), 1e-9))
        push_x = push * (held * errors[0] - p.yaw_push * errors[2] * y)
        push_y = push * (held * errors[1] + p.yaw_push * errors[2] * x)
        return senses.frame.to_body((x + push_x, y + push_y, z + lifted + p.servo_lead * rising))

    def _levelled(self, senses: Senses, feet: Vector, weight: Floats, brace: Floats) -> Vector:
        """Feet in the base frame turned against the turn that the trunk is to make, by their weight (4, n).

        The trunk is to lean with the ground; a trunk turns by (roll, pitch) on feet that turn by the opposite.
        """
        p = self.parameters
        forward, lateral = self.ground.slope
        roll = p.slope_share * np.arctan(lateral) - senses.frame.roll
        pitch = -p.slope_share * np.arctan(forward) - senses.frame.pitch
        sliding = brace * (1.0 - self.hold)
        gain = weight * (p.tilt_gain + sliding * (p.brace_tilt_gain - p.tilt_gain))
        damping = weight * (p.tilt_damping + sliding * (p.brace_tilt_damping - p.tilt_damping))
        roll = gain * np.clip(roll, -LARGEST_TILT_ERROR, LARGEST_TILT_ERROR) - damping * senses.roll_rate
        pitch = gain * np.clip(pitch, -LARGEST_TILT_ERROR, LARGEST_TILT_ERROR) - damping * senses.pitch_rate
        x, y, z = feet
        return x - pitch * z, y + roll * z, z - roll * y + pitch * x

    def _force(self, cycle: LegCycle, brace: Floats) -> Floats:
        """Ground force expected on each foot, N, (4, n)."""
        return np.maximum(load(cycle), BRACED_LOAD * brace) * self.parameters.stance_load


def _rectangle(robot: Robot, length: float, width: float) -> Floats:
    """Feet at its corners, (2, 4, 1)."""
    return np.stack((np.sign(hips(robot)[0]) * (length / 2.0), robot.side[:, None] * (width / 2.0)))


def _under(frame: LevelFrame, places: Floats) -> Floats:
    """Points of the trunk's plane in the level frame, (2, 4, n): legs hang along gravity from there."""
    return np.stack(frame.to_level((places[0], places[1], np.zeros(1)))[:2])


def _joints(robot: Robot, feet: Vector, force: Floats) -> Floats:
    """Joint targets (n, 12), rad, for feet in the base frame that carry a force, N."""
    hip_x, hip_y = hips(robot)
    x, y = feet[0] - hip_x, feet[1] - hip_y
    hip, thigh, calf = leg_angles(robot, x, y, np.minimum(feet[2], -SHORTEST_DROP), legs_first=True)
    return np.stack(held_up(robot, hip, thigh, calf, x, y, force, leg_axis=0), axis=1).reshape(robot.num_joints, -1).T
