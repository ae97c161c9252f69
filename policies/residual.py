"""A base policy corrected, within bounds, by a small network; training and running share all of it but the network."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from policies.base import Actions, Floats, GaitedPolicy, Policy, ShiftableFootholds, ShiftableGait, within_limits
from policies.history import History, Inputs
from policies.legs.kinematics import foot_positions, joint_angles
from policies.network import Network
from quad_env.robots.robot import Robot
from quad_env.task.observations import observation_table

Space = Literal["joints", "feet"]
"""What a correction is added to: the base's joint targets, or the places of the feet that these stand for."""
PRESENT = Inputs()
"""Those of a network that sees the present observation and its base alone."""
SHIFTED = (
    *("forward", "lateral", "yaw_rate"),
    *("frequency", "step_height", "body_height"),
    *("foothold_forward", "foothold_lateral"),
)
"""What of its base a residual can shift: the command that this is shown, m/s, m/s and rad/s, its gait, Hz, m, m, and
where its feet land, m."""
COMMAND, GAIT, FOOTHOLD = slice(0, 3), slice(3, 6), slice(6, 8)
"""Which of them are the command's, the gait's and the footholds'."""
NO_SHIFT = np.zeros(len(SHIFTED), np.float32)
"""Authority over these of a residual over joints alone."""


def authority_of(robot: Robot, hip: float = 0.15, joint: float = 0.3) -> Actions:
    """Largest correction of each joint, rad, (12,), of hip and of other joints; of more than this a learner would learn
    from scratch in disguise.
    """
    return np.tile(np.array([hip, joint, joint], np.float32), len(robot.leg_names))


class Features:
    """What the network over a base sees of n robots, about unit size.

    The scaled observation; over a gaited base the sine and cosine of its phase, and its action minus the home pose;
    sine and cosine of a clock of its own; what is remembered of the scaled observations before; then what the base
    is shifted by, in shares of the authority, of a residual that has authority over that.
    """

    def __init__(self, base: Policy, inputs: Inputs = PRESENT, shift_authority: Actions = NO_SHIFT) -> None:
        self.base, self.inputs = base, inputs
        self._table = observation_table(base.robot)
        self._history = History(inputs, self._table.size, base.control_period)
        self.ticks = np.zeros(1)
        """Observations that each robot has been seen with since it began, (n,)."""
        self._shifted = np.flatnonzero(shift_authority)
        self._shift_scale = 1.0 / shift_authority[self._shifted]
        gaited = 2 + base.robot.num_joints if isinstance(base, GaitedPolicy) else 0
        self.width = self._table.size + gaited + (2 if inputs.clock else 0) + self._history.width + len(self._shifted)
        """Numbers of a row."""

    def reset(self, num_envs: int) -> None:
        """Forget the past, of so many robots; the base is reset by who uses it."""
        self._history.reset(num_envs)
        self.ticks = np.zeros(num_envs)

    def reset_where(self, mask: NDArray[np.bool_]) -> None:
        """Forget the past of the robots where the mask, (n,), is true."""
        self._history.reset_where(mask)
        self.ticks[mask] = 0.0

    def see(
        self, observation: NDArray[np.float32], base_action: Actions, shift: NDArray[np.float32] = NO_SHIFT
    ) -> NDArray[np.float32]:
        """Features (n, `width`) of observations (n, k) that the base, shifted by (n, 8), has just answered with its
        action, (n, 12)."""
        self.ticks += 1.0
        scaled = observation * self._table.scale
        seen = [scaled]
        if isinstance(self.base, GaitedPolicy):
            seen += [_hands(self.base.phase), base_action - _home(self.base.robot)]
        if self.inputs.clock:
            seen += [_hands(2.0 * np.pi * self.inputs.clock * self.base.control_period * self.ticks)]
        if self._history.width:
            seen += [self._history.see(scaled)]
        if len(self._shifted):
            seen += [shift[:, self._shifted] * self._shift_scale]
        return np.concatenate(seen, axis=-1) if len(seen) > 1 else scaled


def correction_width(robot: Robot, shift_authority: Actions) -> int:
    """How many numbers a correction has: one a joint, and one for each thing that may be shifted."""
    return robot.num_joints + int(np.count_nonzero(shift_authority))


def parted(
    robot: Robot,
    correction: NDArray[np.float32],
    shift_authority: Actions,
    before: NDArray[np.float32],
    share: float = 1.0,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """What a correction (n, k) of any size does within -1 … 1: shares of the joints' authority, (n, 12), and the shift
    of the base, in the units of SHIFTED, (n, 8).

    With a share of 1 the correction is the shift, in shares of the authority; with a smaller one it changes the shift
    from what it was before, (n, 8), by at most that share of the authority.
    """
    one = np.float32(1.0)
    joints, shares = np.split(np.clip(correction, -one, one), [robot.num_joints], axis=1)
    shift, shiftable = np.zeros((len(joints), len(NO_SHIFT)), np.float32), np.flatnonzero(shift_authority)
    most = shift_authority[shiftable]
    if share < 1.0:
        shift[:, shiftable] = np.clip(before[:, shiftable] + np.float32(share) * most * shares, -most, most)
    else:
        shift[:, shiftable] = most * shares
    return joints, shift


def shift_share(shift_time: float, hold: int, control_period: float) -> float:
    """Share of its authority by which a shift can change in one correction that is held for so many control steps,
    when it takes `shift_time` s from none to all of it."""
    return min(hold * control_period / shift_time, 1.0) if shift_time else 1.0


def check_shiftable(base: Policy, shift_authority: Actions) -> None:
    """Raise ValueError, one line, if so large a shift, (8,), is more than the base can walk by."""
    if shift_authority[FOOTHOLD].any() and not isinstance(base, ShiftableFootholds):
        raise ValueError(f"the footholds of {base.name} cannot be shifted; those of mpc and mpc_wbc can")
    if not (gait := shift_authority[GAIT]).any():
        return
    if not isinstance(base, ShiftableGait):
        raise ValueError(f"the gait of {base.name} cannot be shifted; those of the trots, mpc and mpc_wbc can")
    if gait[0] >= base.frequency:
        raise ValueError(f"a shift of {gait[0]:g} Hz would stop the gait of {base.name}, of {base.frequency:g} Hz")


def answer(base: Policy, observation: NDArray[np.float32], shift: NDArray[np.float32]) -> Actions:
    """Actions (n, 12) of the base for observations (n, k), its gait and the command that it is shown shifted by
    (n, 8)."""
    if isinstance(base, ShiftableGait):
        base.gait_shift = shift[:, GAIT].astype(np.float64)
    if isinstance(base, ShiftableFootholds):
        base.foothold_shift = shift[:, FOOTHOLD].astype(np.float64)
    if shift[:, COMMAND].any():
        observation = observation.copy()
        observation[:, observation_table(base.robot).slices["command"]] += shift[:, COMMAND]
    return base.act(observation)


def compose(
    robot: Robot,
    base_action: Actions,
    correction: NDArray[np.float32],
    authority: Actions,
    space: Space = "joints",
) -> Actions:
    """The base's action (n, 12) plus authority (12,), rad, times the correction in [-1, 1], within the joint limits,
    rad; over feet the authority is in m, of x, y, z of each foot in its hip frame."""
    one = np.float32(1.0)
    change = authority * np.clip(correction, -one, one)
    if space == "feet":
        change = _turned(robot, base_action, change)
    return within_limits(robot, base_action + change)


def _turned(robot: Robot, joints: Actions, offset: NDArray[np.float32]) -> Actions:
    """What turns joints (n, 12), rad, so that the feet move by (n, 12), m; exactly zero for feet that stay."""
    legs = (-1, len(robot.leg_names), 3)
    feet = foot_positions(robot, joints.reshape(legs))
    turned = joint_angles(robot, feet + offset.reshape(legs)) - joint_angles(robot, feet)
    return turned.reshape(joints.shape).astype(np.float32)


def _hands(phase: Floats) -> NDArray[np.float32]:
    return np.stack([np.sin(phase), np.cos(phase)], axis=-1).astype(np.float32)


def _home(robot: Robot) -> Actions:
    return robot.home_pose.astype(np.float32)


class ResidualPolicy(Policy):
    """base + authority · network(features); with a zero correction its base, bit for bit. Its robot is its base's."""

    correction: NDArray[np.float32]
    """The latest correction, in shares of the authority, -1 … 1, shape (n, 12); zero before the first action."""
    base_action: Actions
    """The base's latest action, rad, shape (n, 12); the home pose before the first."""
    shift: NDArray[np.float32]
    """What the base is shifted by next, in the units of SHIFTED, shape (n, 8); zero at first."""

    def __init__(
        self,
        base: Policy,
        network: Network,
        authority: Actions | None = None,
        name: str = "residual",
        inputs: Inputs = PRESENT,
        hold: int = 1,
        shift_authority: Actions = NO_SHIFT,
        space: Space = "joints",
        shift_time: float = 0.0,
    ) -> None:
        robot = base.robot
        self.shift_time = shift_time
        """Time from no shift to the largest, s; at 0 the network gives the shift itself, otherwise its change."""
        self._shift_share = shift_share(shift_time, hold, base.control_period)
        self.space = space
        """What the correction is added to, which the authority's unit goes with."""
        check_shiftable(base, shift_authority)
        self.features = Features(base, inputs, shift_authority)
        self.shift_authority = shift_authority
        """Largest shift of the base, in the units of SHIFTED, (8,)."""
        outputs = correction_width(robot, shift_authority)
        self.hold = hold
        """Control steps that a correction is held, while the base goes on at every one."""
        if network.sizes[0] != self.features.width or network.sizes[-1] != outputs:
            raise ValueError(
                f"a network over {base.name} needs {self.features.width} inputs and {outputs} outputs, "
                f"not {network.sizes[0]} and {network.sizes[-1]}"
            )
        self.base = base
        self.network = network
        self.authority = authority if authority is not None else authority_of(robot)
        self.name = name
        super().__init__(robot=robot, control_period=base.control_period)
        self._allocate(1)

    @property
    def phase(self) -> Floats | None:
        """The base's phase, rad, shape (n,); None over a base without a clock."""
        return self.base.phase if isinstance(self.base, GaitedPolicy) else None

    def reset(self, num_envs: int = 1, seed: int | None = None) -> None:
        """Start `num_envs` robots anew, base included."""
        super().reset(num_envs, seed)
        self.base.reset(num_envs, seed)
        self.features.reset(num_envs)

    def _allocate(self, num_envs: int) -> None:
        self.correction = np.zeros((num_envs, self.robot.num_joints), np.float32)
        self.base_action = np.tile(_home(self.robot), (num_envs, 1))
        self.shift = np.zeros((num_envs, len(NO_SHIFT)), np.float32)

    def _restart(self, mask: NDArray[np.bool_]) -> None:
        self.base.reset_where(mask)
        self.features.reset_where(mask)
        self.correction = np.where(mask[:, None], np.float32(0.0), self.correction)
        self.base_action = np.where(mask[:, None], _home(self.robot), self.base_action)
        self.shift = np.where(mask[:, None], np.float32(0.0), self.shift)

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        self.base_action = answer(self.base, observation, self.shift)
        seen = self.features.see(observation, self.base_action, self.shift)
        if (due := (self.features.ticks - 1.0) % self.hold == 0.0).any():
            corrected = self.network(seen)
            joints, shift = parted(self.robot, corrected, self.shift_authority, self.shift, self._shift_share)
            self.correction = np.where(due[:, None], joints, self.correction)
            self.shift = np.where(due[:, None], shift, self.shift)
        return compose(self.robot, self.base_action, self.correction, self.authority, self.space)
