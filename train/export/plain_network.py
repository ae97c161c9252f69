"""Conversion of a policy bundle to a plain network: observation terms in, joint actions out.

Other projects compute `target = default_position + action_scale * action` from the outputs of a network, and observe
the previous action as the network gave it. A bundle computes `target = base + authority * correction`, observes the
previous target in rad, and limits the correction and the target. The conversion folds all differences into the first
and the last layer, so that the two give the same joint targets:

- The previous target minus the home pose is `action_scale * action`. The first layer gets the factor.
- The pose of the base policy becomes a part of the last bias.
- The limits of the correction and of the joints become limits of the output.
- The clock of a bundle is one control step ahead of the clock of other projects. The first layer gets the rotation.
- Joint angles have the signs and zeros of the model file of the robot.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from policies.base import Floats, PolicyError
from policies.external.joint_mapping import JointMapping, map_joints
from policies.external.spec import PolicySpec, SpecTerm
from policies.history import Inputs, lag_steps
from policies.input_terms import GAIT_PHASE, TermInputs
from policies.poses import Stand
from policies.residual import ResidualPolicy
from quad_env.robots.robot import Robot
from quad_env.task.observations import observation_table

NETWORK = Path("policy.onnx")
"""Path of the network in a specification before a format has its own name for it."""
MIN_CLOCK_THRESHOLD = 1e-6
"""Norm of the velocity command below which a clock that is hidden at rest is (0, 0).

A bundle hides its clock at a command of exactly zero."""
_OTHER_FEATURES = {"gait_clock": "clock", "position_error": "position error"}
"""Name of a term that is no term of the environment's observation -> kind of the features that show it."""
_JOINT_TERMS = ("joint_position", "joint_velocity")
"""Names of the observation terms with one value per joint, measured by sensors."""


@dataclass(frozen=True)
class PlainNetwork:
    """A multilayer perceptron with exponential linear units, and the specification of its inputs and outputs.

    The inputs are the observation terms of the specification, term by term, each with its history, oldest step first.
    """

    robot: Robot
    """Robot of the policy, with the servo gains of its training."""
    spec: PolicySpec
    """Observation terms, joints in the order of the robot, gains, default position and rate."""
    weights: tuple[Floats, ...]
    """Weight matrix of each layer, (inputs, outputs)."""
    biases: tuple[Floats, ...]
    """Bias vector of each layer, (outputs,)."""
    min_action: Floats
    """Lower limit of each output, (12,)."""
    max_action: Floats
    """Upper limit of each output, (12,)."""
    control_period: float
    """Control period of the environment, s."""
    hold: int
    """Number of control steps of the environment for which the policy holds an action."""
    gate: Floats | None = None
    """Matrix of a clock that the network hides at rest, (inputs, inputs); None if the clock always runs.

    The inputs are multiplied by sign(absolute inputs @ gate + gate bias), which is 0 or 1."""

    @property
    def gate_bias(self) -> Floats:
        """Bias of the gate, (inputs,): 1 for inputs that the gate never hides, else 0."""
        assert self.gate is not None
        return np.where(self.gate.any(axis=0), 0.0, 1.0)

    @property
    def rows(self) -> dict[str, slice]:
        """Name of each observation term -> rows of the first weight matrix that it has."""
        ends = np.cumsum([term.step_width * term.history for term in self.spec.terms]).tolist()
        starts = [0, *ends[:-1]]
        names = [term.name for term in self.spec.terms]
        return {name: slice(*ends) for name, *ends in zip(names, starts, ends, strict=True)}


def plain_network(policy: ResidualPolicy, source: str, describes_all: bool = False) -> PlainNetwork:
    """Convert a trained policy to a plain network.

    PolicyError is raised if the policy computes something that is no network of observation terms; the message names
    it.

    Args:
        policy: Trained policy.
        source: Path or name of the policy, for error messages.
        describes_all: True if the specification may have past values at any age, averages, position errors and a clock
            with a variable frequency; otherwise it has only histories of control steps and a constant clock.

    Returns:
        The plain network. Terms that the network ignores, with weights of zero, are left out.
    """
    _check_base(policy, source)
    _check_inputs(policy, source, describes_all)
    robot = policy.robot
    joints = map_joints(robot.joint_names, robot)
    terms, columns = _lay_out(policy, joints, describes_all)
    weights = [each.astype(np.float64) for each in policy.network.weights]
    weights[0] = columns @ weights[0]
    biases = [each.astype(np.float64) for each in policy.network.biases]
    authority = policy.authority.astype(np.float64)
    factors = joints.signs * authority / _action_scale(policy)
    shift = joints.signs * (_base_pose(policy) - robot.home_pose) / _action_scale(policy)
    weights[-1] = weights[-1] * factors
    biases[-1] = biases[-1] * factors + shift
    limits = _output_limits(policy, joints, shift)
    spec = _describe(policy, joints, terms)
    return _without_ignored_terms(
        PlainNetwork(robot, spec, tuple(weights), tuple(biases), *limits, policy.control_period, policy.hold)
    )


def _check_base(policy: ResidualPolicy, source: str) -> None:
    """Raise PolicyError if the base policy is a controller rather than a fixed pose."""
    if not isinstance(policy.base, Stand):
        raise PolicyError(
            f"{source}: it corrects the controller {policy.base.name}, which a network file cannot hold",
            f"distil it into a network first: python -m train --teacher {source} --out runs/student",
        )


def _check_inputs(policy: ResidualPolicy, source: str, describes_all: bool) -> None:
    """Raise PolicyError for the first network input that a format cannot describe.

    A format that does not describe all inputs has observation terms with a history of control steps, and a clock.
    """
    if policy.height_scan is not None:
        raise PolicyError(f"{source}: height scan: no deployment file can say how a policy observes it; valid: none")
    if describes_all:
        return
    inputs = policy.features.inputs
    unsupported = {
        "averages": inputs.averages,
        "position_error": inputs.position_error,
        "clock_gain": inputs.clock_gain if inputs.clock else 0.0,
    }
    for name, value in unsupported.items():
        if value:
            raise PolicyError(f"{source}: inputs.{name}: only --to toml can say it, got {value}; valid: none")
    period = policy.hold * policy.control_period
    for lag in inputs.lags:
        if lag_steps(lag, policy.control_period) % policy.hold:
            fault = f"only --to toml can say other ages than multiples of the policy's period {period:g} s, got {lag:g}"
            raise PolicyError(f"{source}: inputs.lags: {fault}")


def _action_scale(policy: ResidualPolicy) -> Floats:
    """Return the change of each joint target per unit of the plain network's output, (12,), rad.

    It is the authority of the policy, or 1 for a joint that the policy does not correct.
    """
    authority = policy.authority.astype(np.float64)
    return np.where(authority > 0.0, authority, 1.0)


def _base_pose(policy: ResidualPolicy) -> Floats:
    """Return the joint targets of the base policy, (12,), rad, within the joint limits."""
    assert isinstance(policy.base, Stand)
    return np.clip(policy.base.pose, *policy.robot.action_limits).astype(np.float32).astype(np.float64)


def _output_limits(policy: ResidualPolicy, joints: JointMapping, shift: Floats) -> tuple[Floats, Floats]:
    """Return the smallest and the largest action of each joint, (12,): limits of the correction and of the joint.

    `shift` is the action of each joint at which the target is the pose of the base policy, (12,).
    """
    low, high = policy.robot.action_limits
    ends = joints.signs * (np.stack((low, high)).astype(np.float64) - policy.robot.home_pose)
    ends = np.sort(ends / _action_scale(policy), axis=0)
    if not policy.bounded:
        return ends[0], ends[1]
    reach = policy.authority / _action_scale(policy)
    return np.clip(ends[0], shift - reach, shift + reach), np.clip(ends[1], shift - reach, shift + reach)


def _lay_out(policy: ResidualPolicy, joints: JointMapping, describes_all: bool) -> tuple[tuple[SpecTerm, ...], Floats]:
    """Return the observation terms, and the matrix that maps them to the features of the bundle.

    The first layer of the plain network is matrix @ first layer of the bundle; the matrix is (plain inputs, features).
    """
    terms = []
    rows = []
    for plain_term, factors in _plain_terms(policy, joints):
        term, shown = _shown_columns(policy, plain_term, describes_all)
        matrix = np.zeros((len(shown), term.width, policy.features.width))
        for values, columns in zip(matrix, shown, strict=True):
            if columns is not None:
                values[:, columns] = factors
        terms.append(term)
        rows.append(matrix.reshape(-1, policy.features.width))
    return tuple(terms), np.concatenate(rows)


def _shown_columns(
    policy: ResidualPolicy, term: SpecTerm, describes_all: bool
) -> tuple[SpecTerm, list[NDArray[np.intp] | None]]:
    """Return an observation term with its past values, and the features that show each value of it.

    The list has the columns of the features for each value, in the order of the plain inputs; None for a value that no
    feature shows.
    """
    features = policy.features
    if features.terms is not None:
        return _stacked_columns(features.terms, term)
    if term.name in _OTHER_FEATURES:
        return term, [_columns(features.columns[_OTHER_FEATURES[term.name]])]
    table = observation_table(policy.robot)
    present = _columns(table.slices[term.name])
    past = [features.columns["history"].start + table.size * each + present for each in range(features.inputs.frames)]
    if describes_all:
        return replace(term, lags=features.inputs.lags, averages=features.inputs.averages), [present, *past]
    ages = [0, *(lag_steps(lag, policy.control_period) // policy.hold for lag in features.inputs.lags)]
    columns_by_age = dict(zip(ages, [present, *past], strict=True))
    history = max(ages) + 1
    return replace(term, history=history), [columns_by_age.get(age) for age in range(history - 1, -1, -1)]


def _stacked_columns(inputs: TermInputs, term: SpecTerm) -> tuple[SpecTerm, list[NDArray[np.intp] | None]]:
    """Return an observation term with its history, and the features of each value of it, as `_shown_columns` does."""
    name = GAIT_PHASE if term.name == "gait_clock" else term.name
    layout = next(each for each in inputs.layout if each.name == name)
    columns = np.arange(*layout.columns).reshape(layout.history, layout.width)
    return replace(term, history=layout.history), list(columns)


def _columns(part: slice) -> NDArray[np.intp]:
    """Return the columns of a slice."""
    return np.arange(part.start, part.stop)


def _plain_terms(policy: ResidualPolicy, joints: JointMapping) -> Iterator[tuple[SpecTerm, Floats]]:
    """Yield each observation term, and the matrix that maps its scaled values to the features of the bundle."""
    yield from _observation_terms(policy, joints)
    inputs = policy.features.inputs
    if inputs.clock:
        yield _clock_term(inputs), _clock_rotation(policy)
    if inputs.position_error:
        yield SpecTerm("position_error", bound=inputs.position_error), np.eye(3)


def _observation_terms(policy: ResidualPolicy, joints: JointMapping) -> Iterator[tuple[SpecTerm, Floats]]:
    """Yield each term of the observation, with the diagonal matrix that gives the features of the bundle."""
    table = observation_table(policy.robot)
    for name in policy.features.inputs.terms or table.slices:
        part = table.slices[name]
        scale = table.scale[part].astype(np.float64)
        factors = joints.signs if name in _JOINT_TERMS else np.ones(len(scale))
        if name == "previous_action":
            factors = joints.signs * _action_scale(policy) * scale
            scale = np.ones(len(scale))
        yield SpecTerm(name, scale=_short(scale)), np.diag(factors)


def _short(scale: Floats) -> tuple[float, ...]:
    """Return the factors of a term, or the one factor if they are equal."""
    values = tuple(scale.tolist())
    return values[:1] if len(set(values)) == 1 else values


def _clock_term(inputs: Inputs) -> SpecTerm:
    threshold = MIN_CLOCK_THRESHOLD if inputs.clock_at_rest == "hidden" else 0.0
    limit = inputs.clock_limit if inputs.clock_gain else 0.0
    return SpecTerm(
        "gait_clock", clock=inputs.clock, zero_below=threshold, clock_gain=inputs.clock_gain, clock_limit=limit
    )


def _clock_rotation(policy: ResidualPolicy) -> Floats:
    """Return the rotation from the plain clock to the clock of the bundle, sine and cosine, (2, 2).

    The first phase of a bundle's clock is its phase after one control step, and 0 in a specification.
    """
    angle = 2.0 * np.pi * policy.features.inputs.clock * policy.control_period
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def _describe(policy: ResidualPolicy, joints: JointMapping, terms: tuple[SpecTerm, ...]) -> PolicySpec:
    """Return the specification of the plain network: joints, gains, default position, action scale, terms, rate."""
    robot = policy.robot
    home = joints.policy_angles(robot.home_pose[None])[0]
    return PolicySpec(
        network=NETWORK,
        control_rate=1.0 / (policy.hold * policy.control_period),
        joints=tuple(robot.joint_names),
        default_position=tuple(home.tolist()),
        action_scale=tuple(_action_scale(policy).tolist()),
        stiffness=tuple(robot.servo_stiffness.tolist()),
        damping=tuple(robot.servo_damping.tolist()),
        terms=terms,
    )


def _without_ignored_terms(network: PlainNetwork) -> PlainNetwork:
    """Return the network without the terms that have only weights of zero; one term is kept in any case.

    The command is kept if a clock is hidden at rest, because the network then depends on it.
    """
    first = network.weights[0]
    hides_clock = any(term.zero_below for term in network.spec.terms)
    is_used = {name: bool(first[rows].any()) for name, rows in network.rows.items()}
    if "command" in is_used:
        is_used["command"] |= hides_clock
    names = [name for name, used in is_used.items() if used] or [network.spec.terms[0].name]
    terms = tuple(term for term in network.spec.terms if term.name in names)
    kept: NDArray[np.float64] = np.concatenate([first[network.rows[term.name]] for term in terms])
    return replace(network, spec=replace(network.spec, terms=terms), weights=(kept, *network.weights[1:]))


def with_clock_gate(network: PlainNetwork) -> PlainNetwork:
    """Return a network that hides its clock at rest itself, for formats with a clock that always runs.

    The network without a hidden clock, or without a command, is returned unchanged.

    Args:
        network: Plain network.

    Returns:
        Network with the same outputs, and with a clock that always runs.
    """
    rows = network.rows
    clock = next((term for term in network.spec.terms if term.zero_below), None)
    if clock is None or "command" not in rows:
        return network
    inputs = np.arange(len(network.weights[0]))
    command_inputs = inputs[rows["command"]].reshape(-1, 3)
    clock_inputs = inputs[rows[clock.name]].reshape(-1, 2)
    gate = np.zeros((len(inputs), len(inputs)))
    for command_step, clock_step in zip(command_inputs[::-1], clock_inputs[::-1], strict=False):
        gate[np.ix_(command_step, clock_step)] = 1.0
    terms = tuple(replace(term, zero_below=0.0) for term in network.spec.terms)
    return replace(network, spec=replace(network.spec, terms=terms), gate=gate)


def with_folded_scales(network: PlainNetwork, *names: str) -> PlainNetwork:
    """Return the network with the scales of some observation terms in its first layer, for formats without a scale.

    Args:
        network: Plain network.
        *names: Names of the terms; a term that the network lacks is ignored.

    Returns:
        Network with the same outputs, and with the scale 1 of the terms.
    """
    first = network.weights[0].copy()
    terms = []
    for term in network.spec.terms:
        if term.name in names:
            repetitions = term.history * term.step_width // term.width
            factors = np.tile(np.broadcast_to(term.scale, term.width), repetitions)
            first[network.rows[term.name]] *= factors[:, None]
        terms.append(replace(term, scale=(1.0,)) if term.name in names else term)
    return replace(network, spec=replace(network.spec, terms=tuple(terms)), weights=(first, *network.weights[1:]))
