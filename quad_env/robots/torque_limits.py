"""Largest joint torques of the actuators of a user's model, as MuJoCo adds and clamps them.

The forces of all actuators of a joint add. An actuator acts on a joint, or through a fixed tendon on several joints.
The torque is unknown where the lever depends on the pose (a site, a slider-crank, a spatial tendon) or the force has no
limit.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from quad_env.robots.shapes import Floats

UNKNOWN = -np.inf, np.inf
NUM_POSES = 4
"""Number of random poses that reveal the joints of an actuator with a pose-dependent lever."""


def torque_ranges(model: Any, joints: Sequence[int]) -> Floats:
    """Return the least and the largest torque of hinges of a compiled model.

    Args:
        model: Compiled `mujoco.MjModel`.
        joints: Ids of k hinges.

    Returns:
        Ranges, (k, 2), N·m; infinite where the model does not say, which includes joints without an actuator.
    """
    import mujoco

    kinds = mujoco.mjtTrn
    ranges = np.zeros((model.njnt, 2))
    driven = np.zeros(model.njnt, bool)
    pulls: dict[int, list[tuple[float, Floats]]] = {}
    for actuator in range(model.nactuator):
        kind = int(model.actuator_trntype[actuator])
        target = int(model.actuator_trnid[actuator, 0])
        force = _force_range(mujoco, model, actuator)
        if kind in (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT):
            ranges[target] += _times(_gear(model, actuator), force)
            driven[target] = True
        elif kind == kinds.mjTRN_TENDON and model.tendon_type[target] == mujoco.mjtTendon.mjTENDON_FIXED:
            pulls.setdefault(target, []).append((_gear(model, actuator), force))
        elif kind != kinds.mjTRN_BODY:
            moved = _moved_joints(mujoco, model, actuator)
            ranges[moved] = UNKNOWN
            driven[moved] = True
    for tendon, its in pulls.items():
        pull = _pull(its, model.tendon_actfrcrange[tendon] if model.tendon_actfrclimited[tendon] else None)
        first = int(model.tendon_adr[tendon])
        for wrap in range(first, first + int(model.tendon_num[tendon])):
            joint = int(model.wrap_objid[wrap])
            ranges[joint] += _times(float(model.wrap_prm[wrap]), pull)
            driven[joint] = True
    ranges[~driven] = UNKNOWN
    limited = np.flatnonzero(model.jnt_actfrclimited)
    lower, upper = model.jnt_actfrcrange[limited].T[:, :, None]
    ranges[limited] = ranges[limited].clip(lower, upper)
    return ranges[list(joints)]


def _pull(actuators: Sequence[tuple[float, Floats]], limits: Floats | None) -> Floats:
    """Return the range of the force along a tendon, (2,), N or N·m.

    Args:
        actuators: Gear, and range of the force before it, of each actuator of the tendon.
        limits: Range of the sum of the forces before their gears; None without one.
    """
    if len(actuators) == 1 and limits is not None:
        gear, force = actuators[0]
        return _times(gear, force.clip(*limits))
    if limits is None or not np.isfinite([force for _, force in actuators]).all():
        return np.asarray(sum(_times(gear, force) for gear, force in actuators))
    turned = [(-gear, force) for gear, force in actuators]
    return np.array((-_largest_pull(turned, limits), _largest_pull(actuators, limits)))


def _largest_pull(actuators: Sequence[tuple[float, Floats]], limits: Floats) -> float:
    """Return the largest sum of gears times forces with a sum in the limits; the smallest gear yields first."""
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


def _times(factor: float, force: Floats) -> Floats:
    """Return the range of a force times a factor, lower end first; zero times infinity is zero."""
    with np.errstate(over="ignore"):  # infinite: unknown
        return np.sort(factor * force) if factor else np.zeros(2)


def _force_range(mujoco: Any, model: Any, actuator: int) -> Floats:
    """Return the range of an actuator's force before its gear, (2,), N or N·m; infinite without a limit."""
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
        force = _times(float(gains[0]), _input_range(mujoco, model, actuator)) + bias
    if model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_MUSCLE:
        force = np.array((-np.inf, 0.0))  # it only pulls
    brakes = model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_AFFINE and not gains[:2].any()
    if brakes and no_bias and model.actuator_plugin[actuator] < 0:
        return np.zeros(2)  # a damper, which drives nothing
    if model.actuator_forcelimited[actuator]:
        force = force.clip(*model.actuator_forcerange[actuator])
    return force


def _input_range(mujoco: Any, model: Any, actuator: int) -> Floats:
    """Return the range of the input of an actuator's gain: its control or its activation."""
    kinds = mujoco.mjtDyn
    kind = int(model.actuator_dyntype[actuator])
    control = int(model.actuator_ctrladr[actuator])
    reach = np.array(UNKNOWN)
    follows = kind in (kinds.mjDYN_NONE, kinds.mjDYN_FILTER, kinds.mjDYN_FILTEREXACT)
    if follows and model.actuator_ctrlnum[actuator] == 1 and model.actuator_ctrllimited[control]:
        reach = model.actuator_ctrlrange[control].copy()
    if kind != kinds.mjDYN_NONE and model.actuator_actlimited[actuator]:
        reach = reach.clip(*model.actuator_actrange[actuator])
    return reach


def _moved_joints(mujoco: Any, model: Any, actuator: int) -> list[int]:
    """Return the ids of the joints on which an actuator has a lever in some sampled pose."""
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    rows = range(
        int(model.actuator_outadr[actuator]), int(model.actuator_outadr[actuator] + model.actuator_outnum[actuator])
    )
    found: set[int] = set()
    for _ in range(NUM_POSES):
        mujoco.mj_integratePos(model, data.qpos, rng.normal(0.0, 0.3, model.nv), 1.0)
        mujoco.mj_fwdPosition(model, data)
        for row in rows:
            start = int(data.moment_rowadr[row])
            entries = slice(start, start + int(data.moment_rownnz[row]))
            dofs = data.moment_colind[entries][data.actuator_moment[entries] != 0.0]
            found.update(int(joint) for joint in model.dof_jntid[dofs])
    return sorted(found)
