"""What a robot does when the next targets take effect, from readings with unknown noise and delay.

The controller estimates noise and delay from the readings. Targets are known, and the robot's dynamics (`servo_step`)
predict the joints' motion within a control period: the delay from target to reading is the one whose targets explain
the joints' speeds best. From the readings the motion is predicted over that delay with the targets that are on their
way (a Smith predictor, "Closer control of loops with dead time", 1957, of the whole body). Where readings are noisy
(`reading_noise`), a Kalman filter weighs them against the prediction; readings without noise are taken as they are.
"""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from policies.gait_cycle import Floats
from policies.legs.ground_plane import above
from policies.memory import PerRobotState, lowpass_gain, per_robot, warm_start_gain
from policies.mpc.motion import MotionState, motion, with_rows
from policies.mpc.reading_noise import GROUPS, SENSED, ReadingNoise
from policies.mpc.servo_step import ServoModel, landing, response
from quad_env import OBSERVATION
from quad_env.actuation.models import IDEAL, Actuator
from quad_env.columns import Mask
from quad_env.physics.dynamics import Dynamics
from quad_env.physics.rotations import cross
from quad_env.robots.robot import Robot
from quad_env.sensing.estimator import unit

T = TypeVar("T", bound=np.generic)

GRAVITY, TURNING, VELOCITY, ANGLES, SPEEDS = GROUPS

MAX_DELAY_STEPS = 19
"""Longest delay that is looked for, control steps."""
DELAY_TIME = 1.0
"""Time constant with which it is taken in how well a delay explains the joints' speeds, s; at first it is a mean."""
LEAST_GAIN = 0.1
"""Of the mean square that the believed delay leaves unexplained, noise apart, what another has to explain..."""
NOISE_GAIN = 0.1
"""... and on top of that this share of the noise's own mean square."""
MODEL_ERROR = 0.05
"""Mean square of the joints' speeds that no delay explains, rad²/s²."""
FIRST_PREDICTED = 2
"""Readings until one has been predicted from another predicted one."""
DELAY_LOOKS = 16
"""Control steps before another delay is believed, but where the legs were bent to see it."""
CALIBRATION_STEPS, CALIBRATION_BEND = (4, 8), 1.1
"""Control steps at the start in which the noise of the readings is measured, of little and of more. Then a robot whose
encoders' delay is not known bends its legs, to so many times the joint angles of the home pose, until these move."""
PROCESS_STD = np.array([0.004, 0.15, 0.04, 0.003, 0.6])
"""What a control step brings of each group beyond the prediction, standard deviations."""
ENCODER_PROCESS_STD, ENCODER_NOISE = np.array([0.0005, 0.1]), np.array([0.0011, 1e3])
"""The same of joints that encoders read, whose contacts are known, rad and rad/s, and the standard deviation of these
readings: of 14 bits, rad, and next to useless, since a difference of two samples is not of the moment of the last."""
PREDICTION_WEIGHT, MAX_PLAN_DEVIATION = 0.5, 1.0
"""Share of the prediction in joints that are planned as well, and what it may differ by from the plan, rad/s: where a
foot lands otherwise than predicted, joints differ by up to 9 rad/s, and the torques by 100 N·m."""
BOUNDS = np.repeat([1.0, 10.0, 4.0, 3.0, 30.0], [3, 3, 3, 12, 12])
"""Largest readings that a motion is carried on to."""
UNSEEN_GROUND_DEPTH = 10.0
"""How far below an unseen ground is, m."""
VELOCITY_OBSERVER_GAIN = 90.0
"""Correction of the speed per error of the angle that was predicted, 1/s; 100 would be that of one control step."""


class DelayCompensator(PerRobotState):
    """Observes n robots, control step by control step of `period` s.

    Args:
        late: control steps by which encoders show the joints late, and speeds as differences; 0: the truth is shown.
    """

    calibrating: Mask = per_robot(True)
    """Robots that stand until noise and delay of their readings are known, (n,)."""
    delays: NDArray[np.int64] = per_robot()
    """Control steps from the reading on which a target rests to when it takes effect, (n,)."""
    _delay_identified: Mask = per_robot(False)
    _prediction_error_by_delay: Floats = per_robot(np.zeros(MAX_DELAY_STEPS + 1), axis=1)
    _targets: Floats = per_robot(axis=1)
    _standing: Mask = per_robot(np.ones((MAX_DELAY_STEPS + 1, 4), np.bool_), axis=1)
    _ground: Floats = per_robot(-UNSEEN_GROUND_DEPTH)
    _base_variance: Floats = per_robot(np.zeros(3))
    _joint_covariance: Floats = per_robot(np.zeros((2, 2)))

    def __init__(
        self, robot: Robot, dynamics: Dynamics, period: float, actuator: Actuator = IDEAL, joint_delay_steps: int = 0
    ) -> None:
        self._robot, self._dynamics, self._period, self._late = robot, dynamics, period, joint_delay_steps
        self.servos = ServoModel(robot, actuator, period)
        self._noise = ReadingNoise(period)
        self._read: MotionState | None = None
        history = np.tile(robot.home_pose, (MAX_DELAY_STEPS + len(self.servos.shares), 1))
        super().__init__(delays=np.int64(joint_delay_steps), _targets=history)

    def reset(self, num_envs: int) -> None:
        """Fresh memory of so many robots."""
        super().reset(num_envs)
        self._read = None

    def copy_state_from(self, mask: Mask, other: "DelayCompensator") -> None:
        """Go on where the mask, (n,), is true with the robots of another observer, as many as these."""
        super().copy_state_from(mask, other)
        assert self._read is not None
        assert other._read is not None
        self._read = with_rows(self._read, mask.nonzero()[0], other._read)

    @property
    def looks(self) -> NDArray[np.int64]:
        """Readings that each robot has had since its start, (n,)."""
        return self._noise.sample_count

    def read(self, observation: NDArray[np.float32], wrench: Floats) -> MotionState:
        """Motion of the robots when they were read, (n, k), with the targets that led to it; trunks were pushed by
        wrenches, (n, 6). Of joints that encoders read, as they were read: `ahead` has the feet that stood."""
        seen = observation.astype(np.float64)
        # What others make of a policy's targets, a residual or the safety layer, is what the joints follow.
        targets = seen[:, OBSERVATION["previous_action"]] + self._robot.home_pose
        self._targets = np.concatenate((targets[None], self._targets[:-1]))
        self._effective = self.servos.filtered_targets(self._targets)
        noise = self._noise.variances(seen[:, SENSED])
        since = self.looks - np.where(noise.any(axis=1), CALIBRATION_STEPS[1], CALIBRATION_STEPS[0])
        self._in_noise_calibration = since <= 0
        self.calibrating = self._in_noise_calibration | ~self._delay_identified & (
            since <= (0 if self._late else MAX_DELAY_STEPS)
        )
        self.noise_unknown = self.calibrating & noise.any(axis=1)
        self._seen, self._variances = seen, noise
        if not self._late:
            self._correct(self._at_estimated_delay(self._standing), wrench)
        found = motion(self._robot, self._dynamics, self._seen)
        if not self._late:
            self._read = found
        return found._replace(targets=self._at_estimated_delay(self._effective))

    def _correct(self, standing: Mask, wrench: Floats) -> None:
        """Correct what was seen with noise by what these feet let it be."""
        if (before := self._read) is None:
            return
        readings, noise = self._seen[:, SENSED], self._variances
        velocities = response(self._robot, before, standing, wrench, self._period).velocities(self._effective)
        self._update_delay_estimate(before, velocities, readings, noise)
        noisy = noise.any(axis=1) | bool(self._late)
        if noisy.any():
            corrected = self._corrected(
                before, self._at_estimated_delay(velocities), readings, self._kalman_gains(noise)
            )
            readings[noisy] = corrected[noisy]
        self._base_variance[~noisy], self._joint_covariance[~noisy] = 0.0, 0.0
        _upright(readings)

    def predict(self, wrench: Floats, touching: Mask, slope: Floats, planned: Floats | None = None) -> MotionState:
        """Motion of the robots when their next targets take effect: after `read`, and knowing which feet touched the
        ground then, (n, 4), and its rise per metre forward and to the left, (2, n). Joints that are no later than they
        usually are keep near to what was `planned`, observations (n, k)."""
        if self._late:
            self._correct(touching, wrench)
            self._read = motion(self._robot, self._dynamics, self._seen)
        assert self._read is not None
        now, seen, ground = self._read, self._seen.copy(), self._ground
        height = _above(now, slope)
        count = touching.sum(axis=1)
        fallen = ground - self._period * now.velocity[:, 2]
        ground[:] = np.where(count, (height * touching).sum(axis=1) / np.maximum(count, 1), fallen)
        ground, uneven = ground.copy(), np.where(touching, height - ground[:, None], 0.0)
        for steps in range(longest := self.delays.max(initial=0), 0, -1):
            rows = (self.delays >= steps).nonzero()[0]
            first = steps == longest and len(rows) == len(seen)
            then = now if first else motion(self._robot, self._dynamics, seen[rows])
            gaps = _above(then, slope[:, rows]) - ground[rows, None] - uneven[rows]
            velocity = landing(self._robot, then, gaps, self._effective[steps - 1, rows], wrench[rows], self._period)
            ground[rows] -= 0.5 * self._period * (then.velocity + velocity[:, :3])[:, 2]
            seen[rows, SENSED] = predict_readings(self._robot, then, velocity, self._period).clip(-BOUNDS, BOUNDS)
        if planned is not None and self._late:
            rows = (self.delays == self._late).nonzero()[0]
            for group, most in ((ANGLES, self._period * MAX_PLAN_DEVIATION), (SPEEDS, MAX_PLAN_DEVIATION)):
                plan = planned[rows, group]
                seen[rows, group] = plan + PREDICTION_WEIGHT * np.clip(seen[rows, group] - plan, -most, most)
        if not len(rows := self.delays.nonzero()[0]):
            return now
        then = motion(self._robot, self._dynamics, seen[rows])
        return then if len(rows) == len(seen) else with_rows(now, rows, then)

    def calibration_targets(self, targets: Floats) -> Floats:
        """The targets, (n, 12), rad, once noise and delay are known; before, the home pose, and then bent legs."""
        bent = np.where(self._in_noise_calibration, 1.0, CALIBRATION_BEND)[:, None]
        return np.where(self.calibrating[:, None], bent * self._robot.home_pose, targets)

    def keep(self, standing: Mask) -> None:
        """Take note of the feet that stand in the control period that begins, (n, 4)."""
        standing = standing | self.calibrating[:, None]
        self._standing = np.concatenate((standing[None], self._standing[:-1]))

    def _at_estimated_delay(self, kept: NDArray[T]) -> NDArray[T]:
        """Of what was kept, (LONGEST + 1, n, …), that which led to the readings."""
        return kept[self.delays, np.arange(len(self.delays))]

    def _update_delay_estimate(self, before: MotionState, velocities: Floats, readings: Floats, noise: Floats) -> None:
        """Believe the delay whose targets explain the joints' speeds best, of readings (n, 33) with noise (n, 5): by
        generalised velocities, (LONGEST + 1, n, 18)."""
        speeds = velocities[..., 6:]
        if self._late:  # what encoders show is the mean over the period
            speeds = 0.5 * (before.generalised[:, 6:] + speeds)
        missed = speeds - readings[:, SPEEDS]
        missed = (missed * missed).sum(axis=2) / missed.shape[2]
        known = self.looks - FIRST_PREDICTED
        share = warm_start_gain(lowpass_gain(self._period, DELAY_TIME), known)
        self._prediction_error_by_delay += np.where(known > 0, share * (missed - self._prediction_error_by_delay), 0.0)
        best, left = (
            self._prediction_error_by_delay.argmin(axis=0),
            self._at_estimated_delay(self._prediction_error_by_delay),
        )
        by_best, of_noise = self._prediction_error_by_delay.min(axis=0), NOISE_GAIN * noise[:, -1]
        explained = self._prediction_error_by_delay[-1] - by_best > MODEL_ERROR + of_noise
        self._delay_identified |= explained & ~self._in_noise_calibration & (self._late == 0)
        least = LEAST_GAIN * np.maximum(left - noise[:, -1], MODEL_ERROR) + of_noise
        better = (left - by_best > least) & (self._delay_identified | (self.looks > DELAY_LOOKS))
        self.delays = np.where(better, best, self.delays)

    def _kalman_gains(self, noise: Floats) -> tuple[Floats, Floats]:
        """What to take in of what a prediction misses, by the noise of each group, (n, 5): of gravity, turning and
        velocity, (n, 3), and of angle and speed into angle and speed, (n, 2, 2)."""
        prior_variance = self._base_variance + PROCESS_STD[:3] ** 2
        share = prior_variance / (prior_variance + noise[:, :3])
        fresh = self.looks == 1  # nothing was predicted that could be doubted
        self._base_variance = np.where(fresh[:, None], self._base_variance, (1.0 - share) * prior_variance)
        # A joint's angle is information on its speed, too; differences of encoders' samples are of no moment.
        step = np.array([[1.0, self._period], [0.0, 1.0]])
        unforeseen, least = (ENCODER_PROCESS_STD, ENCODER_NOISE) if self._late else (PROCESS_STD[3:], np.zeros(2))
        joint_doubt = step @ self._joint_covariance @ step.T + np.diag(unforeseen**2)
        shares = joint_doubt @ np.linalg.inv(joint_doubt + (noise[:, 3:] + least**2)[:, None] * np.eye(2))
        self._joint_covariance = np.where(
            fresh[:, None, None], self._joint_covariance, joint_doubt - shares @ joint_doubt
        )
        return share, shares

    def _corrected(
        self, before: MotionState, velocity: Floats, readings: Floats, shares: tuple[Floats, Floats]
    ) -> Floats:
        """Readings, (n, 33), as the motion a control step before and the velocity now let them be, corrected by those
        shares of what they are."""
        out = predict_readings(self._robot, before, velocity, self._period).clip(-BOUNDS, BOUNDS)
        out = np.where((self.looks == 1)[:, None], readings, out)
        missed, (share, joint_shares) = readings - out, shares
        for number, group in enumerate(GROUPS[:3]):
            out[:, group] += share[:, number, None] * missed[:, group]
        corrections = joint_shares @ np.stack((missed[:, ANGLES], missed[:, SPEEDS]), axis=1)
        out[:, ANGLES] += corrections[:, 0]
        out[:, SPEEDS] += corrections[:, 1]
        return out


class JointPredictor(PerRobotState):
    """Joints of n robots that are shown `late` control steps late, of `period`, s, each: as planned since.

    An encoder's angle of one control step ago, taken for the present one, is off by the joint's speed times 10 ms; a
    controller that inverts the servos' law turns that into torque, 9 N·m in a trot. What the joints have done since is
    known: they have followed the accelerations that were asked for. The predictor goes on with those (Smith, Closer
    control of loops with dead time, 1957), and each late reading corrects what it had predicted for its moment.
    """

    _known: Mask = per_robot(False)
    _angles: Floats = per_robot(np.zeros(12))
    _speeds: Floats = per_robot(np.zeros(12))
    _planned: Floats = per_robot(axis=1)

    def __init__(self, joint_delay_steps: int, period: float) -> None:
        self._late, self._period = joint_delay_steps, period
        super().__init__(_planned=np.zeros((joint_delay_steps, 12)))

    def now(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """The observations, (n, k), with joints as they are now; themselves where they are not late."""
        if not self._late:
            return observation
        shown = observation[:, OBSERVATION["joint_position"]].astype(np.float64)
        expected = np.where(self._known[:, None], self._angles, shown)
        angles, speeds = shown, self._speeds + VELOCITY_OBSERVER_GAIN * (shown - expected)
        for number, acceleration in enumerate(self._planned):
            angles = angles + self._period * speeds + 0.5 * self._period**2 * acceleration
            speeds = speeds + self._period * acceleration
            if number == 0:  # of the moment that is shown next
                self._angles, self._speeds = angles, speeds
        self._known[:] = True
        out = observation.copy()
        out[:, OBSERVATION["joint_position"]], out[:, OBSERVATION["joint_velocity"]] = angles, speeds
        return out

    def keep(self, acceleration: Floats) -> None:
        """Take note of what the joints are asked for in the control period that begins, (n, 12), rad/s²."""
        if self._late:
            self._planned = np.concatenate((self._planned[1:], acceleration[None]))


def predict_readings(robot: Robot, now: MotionState, velocity: Floats, period: float) -> Floats:
    """Readings, (n, 33), of robots a control period later, whose generalised velocity is this one then, (n, 18)."""
    mean = 0.5 * (now.generalised + velocity)
    turned = period * mean[:, 3:6]
    down = -now.rotation[:, 2]
    along = np.matmul(velocity[:, None, :3], now.rotation)[:, 0]
    out = np.empty((len(mean), SENSED.stop))
    out[:, GRAVITY], out[:, VELOCITY] = down - cross(turned, down), along - cross(turned, along)
    out[:, TURNING], out[:, SPEEDS] = velocity[:, 3:6], velocity[:, 6:]
    out[:, ANGLES] = now.angles - robot.home_pose + period * mean[:, 6:]
    return _upright(out)


def _above(now: MotionState, slope: Floats) -> Floats:
    """Height of the feet above the plane of that slope through the trunk's centre, (n, 4), m."""
    forward, lateral = slope
    return above((np.zeros(len(forward)), forward, lateral), now.bodies.feet.T).T


def _upright(readings: Floats) -> Floats:
    """The readings with a direction of gravity of length one, as far as there is one."""
    readings[:, GRAVITY] = unit(readings[:, GRAVITY])
    return readings
