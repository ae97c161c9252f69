"""The observation of a policy from another project, term by term, from the environment's.

What the environment does not show is worked out from what it does: the world frame's yaw by integrating the gyro from 0
at the reset, contacts and torques from the servos.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from policies.base import Floats, Mask, PolicyError
from policies.external.joint_mapping import map_action_joints, map_observed_joints
from policies.external.spec import HeightGrid, ObservationTerm, PolicySpec
from policies.legs.level_frame import level_frame
from policies.memory import PerRobotState, per_robot
from policies.mpc.contact import ContactEstimator
from policies.mpc.motion import motion
from policies.mpc.parameters import TROT, parameters_of
from quad_env.columns import EnvIndices
from quad_env.config import GRAVITY
from quad_env.physics.dynamics import Dynamics
from quad_env.robots.robot import Robot
from quad_env.robots.structure import JOINTS_PER_LEG
from quad_env.sensing.height_scan import HeightScan, table_with

CONTACT_WEIGHT_FRACTION = 0.05
"""Share of the robot's weight from which the estimated force of a foot is a contact: right in 86 to 96 % of the control
steps of SimpleQuad and Go1 with `trot` and `mpc_wbc`, on flat and rough ground and when pushed."""
GRID_RESOLUTION = 1e-3
"""Unit in which the points of a height scan are told apart, m."""


Signals = dict[str, Floats]
"""Of m robots: our observation by term; `angles` of the robot's joints; `yaw`; control `steps` of the policy since the
reset, 0 at the first; `action`, the previous one; `contact` of the robot's feet."""


class ObservationAdapter(PerRobotState):
    """Observations of n robots.

    Args:
        description: of the policy.
        robot: whose observations they are, with the servo gains in force.
        control_period: of the environment, s.
    """

    action: Floats = per_robot()
    """The previous action of each robot as the policy is shown it, (n, 12); to be renewed after each action."""
    _yaw: Floats = per_robot(0.0)
    _turning: Mask = per_robot(False)
    _steps: NDArray[np.int64] = per_robot(0)
    _history: Floats = per_robot()
    _contact: Mask = per_robot(np.zeros(4, np.bool_))

    def __init__(self, description: PolicySpec, robot: Robot, control_period: float) -> None:
        self._description, self._robot, self._period = description, robot, control_period
        self._joints = map_action_joints(description, robot)
        self._observed = map_observed_joints(description, robot)
        default = self._joints.to_robot_order(np.array(description.default_position, dtype=np.float64))
        self._default = default[self._observed.joint_ids]
        self.height_scan = required_height_scan(description)
        self._slices = table_with(robot, self.height_scan).slices
        self._order = _layout(description)
        self._contacts: ContactEstimator | None = None
        self._tracks = any(term.frame == "world" or term.name == "foot_contact" for term in description.terms)
        if any(term.name == "foot_contact" for term in description.terms):
            self._contacts = ContactEstimator(robot, parameters_of(TROT, robot), control_period)
            self._dynamics = Dynamics(robot)
        super().__init__(action=np.zeros(len(description.joints)), _history=np.zeros(_shape(description)))

    def update_state(self, observation: Floats) -> None:
        """Take in the control step that led to the environment's observations, (n, k): turns and contacts."""
        if not self._tracks:
            return
        gravity, (_, pitching, turning) = (
            observation[:, self._slices[name]].T for name in ("projected_gravity", "angular_velocity")
        )
        frame = level_frame(gravity)
        rate = (frame.up_y * pitching + frame.up_z * turning) / frame.level_x**2  # of the x axis' heading
        self._yaw += np.where(self._turning, self._period * rate, 0.0)
        self._turning[:] = True
        if self._contacts is not None:
            now = motion(self._robot, self._dynamics, observation)
            force = self._contacts.estimate(now, np.zeros((len(observation), 6)))[..., 2]
            self._contact = force > CONTACT_WEIGHT_FRACTION * GRAVITY * self._robot.mass

    def observe(self, observation: Floats, who: EnvIndices) -> NDArray[np.float32]:
        """The policy's observations, (m, width), of those robots, whose of the environment are given, (m, k)."""
        seen = {name: observation[:, part] for name, part in self._slices.items()}
        kept: dict[str, Any] = {"yaw": self._yaw, "steps": self._steps, "action": self.action, "contact": self._contact}
        seen |= {name: values[who] for name, values in kept.items()}
        seen["angles"] = seen["joint_position"] + self._robot.home_pose
        now = np.concatenate([_limited(self._numbers(term, seen), term) for term in self._description.terms], axis=1)
        if (bound := self._description.observation_clip) is not None:
            now = np.clip(now, -bound, bound)
        before = self._history[who, 1:]
        if self._description.history_start == "first":
            before = np.where((seen["steps"] == 0)[:, None, None], now[:, None], before)
        history = self._history[who] = np.concatenate((before, now[:, None]), axis=1)
        self._steps[who] += 1
        return history.reshape(len(who), -1)[:, self._order].astype(np.float32)

    def _numbers(self, term: ObservationTerm, seen: Signals) -> Floats:
        """A term's numbers of this control step, (m, width), neither clipped nor scaled."""
        match term.name:
            case "joint_position":
                return self._observed.policy_angles(seen["angles"]) - self._default
            case "absolute_joint_position":
                return self._observed.policy_angles(seen["angles"])
            case "joint_velocity":
                return self._observed.policy_rates(seen["joint_velocity"])
            case "joint_torque":
                return self._observed.policy_rates(_torque(self._robot, seen))
            case "previous_action":
                return seen["action"]
            case "command":
                return seen["command"]
            case "foot_contact":
                return seen["contact"][:, list(dict.fromkeys(self._joints.joint_ids // JOINTS_PER_LEG))]
            case "gait_clock":
                angles = 2.0 * np.pi * term.clock / self._description.control_rate * seen["steps"]
                clock = np.stack((np.sin(angles), np.cos(angles)), axis=1)
                is_moving = np.linalg.norm(seen["command"], axis=1, keepdims=True) >= term.zero_below
                return np.where(is_moving, clock, 0.0)
            case "constant":
                return np.tile(term.values, (len(seen["steps"]), 1))
            case "height_scan":
                assert self.height_scan is not None and term.grid is not None  # noqa: PT018
                apart = self.height_scan.points[None] - _points(term.grid)[:, None]
                places = np.abs(apart).max(axis=-1).argmin(axis=1)
                return -seen["height_scan"][:, places] - term.grid.offset
        return _turned(seen[term.name], term.frame, seen)


def _turned(body: Floats, frame: str, seen: Signals) -> Floats:
    """Vectors of the body in a frame, (m, 3)."""
    if frame == "body":
        return body
    x, y, z = level_frame(seen["projected_gravity"].T).to_level(body.T)
    if frame == "world":
        cosine, sine = np.cos(seen["yaw"]), np.sin(seen["yaw"])
        x, y = cosine * x - sine * y, sine * x + cosine * y
    return np.stack((x, y, z), axis=1)


def _torque(robot: Robot, seen: Signals) -> Floats:
    """What the servos give by the gains in force on the target in force, the joints where they are now, limited to the
    robot's rated torque, (m, 12), N·m."""
    apart = seen["previous_action"] - seen["joint_position"]
    torque = robot.servo_stiffness * apart - robot.servo_damping * seen["joint_velocity"]
    return np.clip(torque, -robot.rated_torque, robot.rated_torque)


def _limited(values: Floats, term: ObservationTerm) -> Floats:
    """Values of a term, clipped, then scaled."""
    clipped: Floats = values if term.clip is None else np.clip(values, *term.clip)
    return np.multiply(clipped, term.scale)


def _shape(description: PolicySpec) -> tuple[int, int]:
    """Control steps of the longest history, and numbers of all terms in one of them."""
    return max(term.history for term in description.terms), sum(term.width for term in description.terms)


def _layout(description: PolicySpec) -> NDArray[np.intp]:
    """Places of the policy's observation in the flattened history of steps, the oldest first, each of all terms."""
    shape, first = _shape(description), description.history_newest == "first"
    steps = np.arange(np.prod(shape)).reshape(shape)[:: -1 if first else 1]
    if description.history_layout == "time":
        return steps.ravel()
    ends = np.cumsum([term.width for term in description.terms])
    each = [steps[:, end - term.width : end] for term, end in zip(description.terms, ends, strict=True)]
    kept = [slice(term.history) if first else slice(-term.history, None) for term in description.terms]
    return np.concatenate([numbers[shown].ravel() for numbers, shown in zip(each, kept, strict=True)])


def _points(grid: HeightGrid) -> Floats:
    """x and y of a grid's points in the order of the observation, (p, 2), m."""
    x, y = np.meshgrid(grid.x, grid.y, indexing="xy" if grid.x_first else "ij")
    return np.stack((x.ravel(), y.ravel()), axis=1)


def required_height_scan(description: PolicySpec) -> HeightScan | None:
    """The environment's height scan in which the points of the policy's are; None without one. Raises PolicyError."""
    grids = [_points(term.grid) for term in description.terms if term.grid is not None]
    if not grids:
        return None
    points = np.concatenate(grids)
    units = np.round(points / GRID_RESOLUTION).astype(int)
    spacing = int(np.gcd.reduce(np.abs(units), axis=None)) or 100
    (ahead, left), (behind, right) = np.maximum(units.max(axis=0), 0), np.maximum(-units.min(axis=0), 0)
    ahead, behind, aside = (int(far) // spacing for far in (ahead, behind, max(left, right)))
    try:
        if np.abs(points / GRID_RESOLUTION - units).max() > 1e-3:
            raise ValueError(f"its points do not lie on a grid of {GRID_RESOLUTION:g} m through the trunk's centre")
        return HeightScan(ahead=ahead, behind=behind, aside=aside, spacing=GRID_RESOLUTION * spacing)
    except ValueError as error:
        raise PolicyError(f"the height_scan of {description.network} cannot be shown: {error}") from None
