"""Computation of the ranges of the joint torques that the actuators of a user's model can apply.

The computation follows MuJoCo's rules. The torques of all actuators of a joint are added. An actuator acts on one
joint, or through a fixed tendon on several joints. The range of a torque is unknown if the actuator's force has no
limit, or if the actuator's lever arm depends on the pose. The lever arm depends on the pose for actuators of sites,
slider-cranks and spatial tendons.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from quad_env.robots.shapes import Bools, Floats

UNKNOWN = (-np.inf, np.inf)
"""Range of a torque, N·m, or force, N, that is unknown or not limited: from minus infinity to infinity."""
NUM_POSES = 4
"""Number of random poses in which `_moved_joints` searches for the joints that an actuator moves."""
_POSE_STD = 0.3
"""Standard deviation of the random steps of the joint angles between the poses of `_moved_joints`, rad."""


def torque_ranges(model: Any, joints: Sequence[int]) -> Floats:
    """Compute the ranges of the torques that the actuators of a user's model can apply to hinges.

    Args:
        model: Compiled `mujoco.MjModel` of the user's file.
        joints: Ids of k hinges.

    Returns:
        Smallest and largest torque of each hinge, (k, 2), N·m. The torques are infinite if the model does not limit the
        torque, or if the hinge has neither an actuator nor a torque limit.
    """
    import mujoco

    totals = _JointTotals(np.zeros((model.njnt, 2)), np.zeros(model.njnt, bool))
    _add_tendons(model, totals, _add_actuators(mujoco, model, totals))
    ranges = totals.ranges
    ranges[~totals.is_driven] = UNKNOWN
    limited = np.flatnonzero(model.jnt_actfrclimited)
    lower, upper = model.jnt_actfrcrange[limited].T[:, :, None]
    ranges[limited] = ranges[limited].clip(lower, upper)
    return ranges[list(joints)]


class _JointTotals(NamedTuple):
    """Sums of the torques that all actuators of a model can apply to each joint.

    The method `add` adds the torques of one actuator.
    """

    ranges: Floats
    """Smallest and largest sum of the torques on each joint, (njnt, 2), N·m."""
    is_driven: Bools
    """Mask that is True for the joints with at least one actuator, (njnt,)."""

    def add(self, joint: int, torque: Floats) -> None:
        """Add the torque range of one actuator to the sum of a joint.

        Args:
            joint: Id of the joint.
            torque: Smallest and largest torque of the actuator, (2,), N·m.
        """
        self.ranges[joint] += torque
        self.is_driven[joint] = True


_TendonForces = dict[int, list[tuple[float, Floats]]]
"""Type of a dictionary: id of a tendon -> gear ratio and force range of each actuator that pulls on the tendon.

The range is the smallest and largest force before the gear ratio is applied, (2,), N or N·m.
"""


def _add_actuators(mujoco: Any, model: Any, totals: _JointTotals) -> _TendonForces:
    """Add the torques of the actuators that act on joints, and collect the forces on fixed tendons.

    The torque of a joint becomes unknown if an actuator with a pose-dependent lever arm moves the joint.

    Args:
        mujoco: The package `mujoco`.
        model: Compiled `mujoco.MjModel`.
        totals: Sums of the torques on each joint, which are changed.

    Returns:
        Id of a fixed tendon -> gear ratio and force range of each of its actuators, for `_add_tendons`.
    """
    kinds = mujoco.mjtTrn
    tendon_forces: _TendonForces = {}
    for actuator in range(model.nactuator):
        kind = int(model.actuator_trntype[actuator])
        target = int(model.actuator_trnid[actuator, 0])
        force = _force_range(mujoco, model, actuator)
        if kind in (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT):
            totals.add(target, _scale_range(_gear(model, actuator), force))
        elif kind == kinds.mjTRN_TENDON and model.tendon_type[target] == mujoco.mjtTendon.mjTENDON_FIXED:
            tendon_forces.setdefault(target, []).append((_gear(model, actuator), force))
        elif kind != kinds.mjTRN_BODY:
            moved = _moved_joints(mujoco, model, actuator)
            totals.ranges[moved] = UNKNOWN
            totals.is_driven[moved] = True
    return tendon_forces


def _add_tendons(model: Any, totals: _JointTotals, tendon_forces: _TendonForces) -> None:
    """Add the torques that fixed tendons apply to their joints.

    Args:
        model: Compiled `mujoco.MjModel`.
        totals: Sums of the torques on each joint, which are changed.
        tendon_forces: Forces of the actuators of each fixed tendon.
    """
    for tendon, forces in tendon_forces.items():
        limits = model.tendon_actfrcrange[tendon] if model.tendon_actfrclimited[tendon] else None
        tension = _tension_range(forces, limits)
        first = int(model.tendon_adr[tendon])
        for wrap in range(first, first + int(model.tendon_num[tendon])):
            totals.add(int(model.wrap_objid[wrap]), _scale_range(float(model.wrap_prm[wrap]), tension))


def _tension_range(actuators: Sequence[tuple[float, Floats]], limits: Floats | None) -> Floats:
    """Compute the range of the force that the actuators of a tendon apply along the tendon.

    Args:
        actuators: Gear ratio, and range of the force before the gear, (2,), of each actuator of the tendon.
        limits: Smallest and largest sum of the actuator forces before the gears, (2,); None if the tendon does not
            limit the sum.

    Returns:
        Smallest and largest force along the tendon, (2,), N or N·m.
    """
    if len(actuators) == 1 and limits is not None:
        gear, force = actuators[0]
        return _scale_range(gear, force.clip(*limits))
    if limits is None or not np.isfinite([force for _, force in actuators]).all():
        return np.asarray(sum(_scale_range(gear, force) for gear, force in actuators))
    reversed_gears = [(-gear, force) for gear, force in actuators]
    return np.array((-_max_tension(reversed_gears, limits), _max_tension(actuators, limits)))


def _max_tension(actuators: Sequence[tuple[float, Floats]], limits: Floats) -> float:
    """Compute the largest force along a tendon that limits the sum of its actuator forces.

    At first, each actuator has the force that contributes most to the force along the tendon. If the sum of these
    forces is outside `limits`, the forces are changed until the sum is within `limits`. The actuator with the smallest
    gear ratio is changed first, because its change reduces the force along the tendon least.

    Args:
        actuators: Gear ratio, and range of the force before the gear, (2,), of each actuator of the tendon.
        limits: Smallest and largest sum of the forces before the gears, (2,).

    Returns:
        Largest sum of gear ratios times forces, N or N·m.
    """
    gears = np.array([gear for gear, _ in actuators])
    lower, upper = np.array([force for _, force in actuators]).T
    forces = np.where(gears > 0.0, upper, lower)
    excess = forces.sum() - np.clip(forces.sum(), *limits)
    for actuator in np.argsort(np.abs(gears)):
        yielding = np.clip(forces[actuator] - excess, lower[actuator], upper[actuator])
        excess -= forces[actuator] - yielding
        forces[actuator] = yielding
    return float(gears @ forces)


def _gear(model: Any, actuator: int) -> float:
    return float(model.actuator_gear[model.actuator_outadr[actuator], 0])


def _scale_range(factor: float, force: Floats) -> Floats:
    """Multiply the range of a force, (2,), by a factor, and return the lower end first.

    Zero times infinity is zero here, because a gear ratio of zero transmits no force.
    """
    with np.errstate(over="ignore"):  # An overflow to infinity is correct: the range is then unknown.
        return np.sort(factor * force) if factor else np.zeros(2)


def _force_range(mujoco: Any, model: Any, actuator: int) -> Floats:
    """Return the smallest and largest force of an actuator before its gear ratio is applied, (2,), N or N·m.

    Both forces are infinite if the model does not limit the force.

    Args:
        mujoco: The package `mujoco`.
        model: Compiled `mujoco.MjModel`.
        actuator: Id of the actuator.

    Returns:
        Smallest and largest force, (2,), N, or torque, N·m.
    """
    if model.opt.disableactuator & (1 << int(model.actuator_group[actuator])):
        return np.zeros(2)
    force = np.array(UNKNOWN)
    gains = model.actuator_gainprm[actuator]
    biases = model.actuator_biasprm[actuator]
    no_bias = model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
    fixed_gain = model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
    fixed_gain = fixed_gain and model.actuator_plugin[actuator] < 0
    constant_bias = model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_AFFINE and not biases[1:3].any()
    if fixed_gain and (no_bias or constant_bias):
        bias = 0.0 if no_bias else float(biases[0])
        force = _scale_range(float(gains[0]), _input_range(mujoco, model, actuator)) + bias
    if model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_MUSCLE:
        force = np.array((-np.inf, 0.0))  # The upper limit is 0, because a muscle can only pull.
    brakes = model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_AFFINE and not gains[:2].any()
    if brakes and no_bias and model.actuator_plugin[actuator] < 0:
        return np.zeros(2)  # The torque is 0, because a damper cannot drive the joint.
    if model.actuator_forcelimited[actuator]:
        force = force.clip(*model.actuator_forcerange[actuator])
    return force


def _input_range(mujoco: Any, model: Any, actuator: int) -> Floats:
    """Return the range of an actuator's input, (2,): its activation if the actuator has one, else its control.

    The force of the actuator is the input times its gain, plus its bias. The range is infinite if the input is not
    limited.

    Args:
        mujoco: The package `mujoco`.
        model: Compiled `mujoco.MjModel`.
        actuator: Id of the actuator.

    Returns:
        Smallest and largest input, (2,).
    """
    kinds = mujoco.mjtDyn
    kind = int(model.actuator_dyntype[actuator])
    control = int(model.actuator_ctrladr[actuator])
    input_range = np.array(UNKNOWN)
    follows = kind in (kinds.mjDYN_NONE, kinds.mjDYN_FILTER, kinds.mjDYN_FILTEREXACT)
    if follows and model.actuator_ctrlnum[actuator] == 1 and model.actuator_ctrllimited[control]:
        input_range = model.actuator_ctrlrange[control].copy()
    if kind != kinds.mjDYN_NONE and model.actuator_actlimited[actuator]:
        input_range = input_range.clip(*model.actuator_actrange[actuator])
    return input_range


def _moved_joints(mujoco: Any, model: Any, actuator: int) -> list[int]:
    """Return the ids of the joints on which an actuator has a lever arm in at least one of several random poses.

    Args:
        mujoco: The package `mujoco`.
        model: Compiled `mujoco.MjModel`.
        actuator: Id of the actuator.

    Returns:
        Ids of the joints, in ascending order.
    """
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    first = int(model.actuator_outadr[actuator])
    rows = range(first, first + int(model.actuator_outnum[actuator]))
    joints: set[int] = set()
    for _ in range(NUM_POSES):
        mujoco.mj_integratePos(model, data.qpos, rng.normal(0.0, _POSE_STD, model.nv), 1.0)
        mujoco.mj_fwdPosition(model, data)
        for row in rows:
            start = int(data.moment_rowadr[row])
            entries = slice(start, start + int(data.moment_rownnz[row]))
            dofs = data.moment_colind[entries][data.actuator_moment[entries] != 0.0]
            joints.update(int(joint) for joint in model.dof_jntid[dofs])
    return sorted(joints)
