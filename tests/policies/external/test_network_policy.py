"""Network policies give the targets of a direct computation, for each robot, in any batch."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from policies.base import PolicyError
from policies.external.network_policy import NetworkPolicy
from policies.external.spec import PolicySpec, SpecTerm
from quad_env import OBSERVATION, SIMPLE_QUAD
from tests.policies.external.small_networks import JOINTS, MIXED, OBSERVED, SmallNetwork, make_spec

pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

LEGS = {"FL": 0, "FR": 1, "RL": 2, "RR": 3}
LINKS = {"hip": 0, "thigh": 1, "calf": 2}
STEPS, ROBOTS = 40, 5
WIDTH = sum(term.width * term.history for term in MIXED)


def place(joint: str) -> int:
    """Return the index of a joint among the joints of SimpleQuad, by its name."""
    leg, link, _ = joint.split("_")
    return 3 * LEGS[leg] + LINKS[link]


class Direct:
    """Direct computation of a robot's joint targets for the terms MIXED with a history of three steps."""

    def __init__(self, description: PolicySpec, act: Callable[[np.ndarray], np.ndarray]) -> None:
        self.d, self.act = description, act
        self.tick, self.shown, self.previous = 0, list[list[np.ndarray]](), np.zeros(12)

    def targets(self, observation: np.ndarray) -> np.ndarray:
        d = self.d
        if self.tick % 2 == 0:
            self.held = self._acted(observation.astype(np.float64))
        self.tick += 1
        targets = np.zeros(12)
        for joint, target in zip(d.joints, self.held, strict=True):
            targets[place(joint)] = target
        return np.clip(targets, SIMPLE_QUAD.joint_lower, SIMPLE_QUAD.joint_upper)

    def _acted(self, observation: np.ndarray) -> np.ndarray:
        d, seen = self.d, {name: observation[part] for name, part in OBSERVATION.items()}
        angles = seen["joint_position"] + SIMPLE_QUAD.home_pose
        default = dict(zip(d.joints, d.default_position, strict=True))
        now = [
            0.25 * np.clip(seen["angular_velocity"], -1.0, 1.0),
            seen["projected_gravity"],
            seen["command"] * (2.0, 2.0, 0.25),
            np.array([angles[place(joint)] - default[joint] for joint in OBSERVED]),
            0.05 * np.array([seen["joint_velocity"][place(joint)] for joint in OBSERVED]),
            self.previous,
        ]
        now = [np.clip(each, -0.9, 0.9) for each in now]
        if not self.shown:
            self.shown = [now if d.history_start == "first" else [0.0 * each for each in now]] * 3
        self.shown = [*self.shown[1:], now]
        steps = self.shown if d.history_newest == "last" else self.shown[::-1]
        by_term = [step[number] for number in range(len(now)) for step in steps]
        by_time = [each for step in steps for each in step]
        raw = self.act(np.concatenate(by_term if d.history_layout == "term" else by_time).astype(np.float32))
        clipped = np.clip(raw, -0.8, 0.8)
        targets = np.array(d.default_position) + np.array(d.action_scale) * clipped
        self.previous = clipped if d.previous_action == "raw" else targets - np.array(d.default_position)
        return targets


def walk(robots: int = ROBOTS) -> np.ndarray:
    """Return random observations, (steps, n, 48)."""
    random = np.random.default_rng(1)
    rows = random.normal(0.0, 0.5, (STEPS, robots, 48)).astype(np.float32)
    gravity = rows[:, :, OBSERVATION["projected_gravity"]] + (0.0, 0.0, -2.0)
    rows[:, :, OBSERVATION["projected_gravity"]] = gravity / np.linalg.norm(gravity, axis=-1, keepdims=True)
    return rows


def restarted(step: int) -> np.ndarray:
    """Return True for the robot that is reset before a step: one after an even and one after an odd number of steps."""
    return np.arange(ROBOTS) == {13: 1, 20: 3}.get(step, -1)


def acted(policy: NetworkPolicy, rows: np.ndarray, *, restarts: bool = False) -> np.ndarray:
    """Return the actions on a sequence of observations, (steps, n, 12)."""
    policy.reset(rows.shape[1])
    found = []
    for step, observation in enumerate(rows):
        if restarts and restarted(step).any():
            policy.reset_where(restarted(step))
        found.append(policy.act(observation))
    return np.array(found)


def network(kind: str, file: Path, numbers: SmallNetwork) -> Path:
    """Write the network in a format, `kind`, and return the path."""
    if kind == "torchscript":
        pytest.importorskip("torch")
        return numbers.torchscript(file.with_suffix(".pt"))
    return numbers.onnx(file.with_suffix(".onnx"), 1 if kind == "onnx of one" or numbers.lstm else "n")


CASES: list[tuple[str, bool, dict[str, Any]]] = [
    ("onnx", False, {"history_layout": "term", "history_newest": "last"}),
    ("onnx", False, {"history_layout": "time", "history_newest": "first", "history_start": "zero"}),
    ("onnx of one", False, {"history_layout": "term", "history_newest": "first", "previous_action": "scaled"}),
    ("onnx", True, {"history_layout": "time", "history_newest": "last"}),
    ("torchscript", False, {"history_start": "zero"}),
    ("torchscript", True, {"previous_action": "scaled"}),
]


@pytest.mark.parametrize(("kind", "lstm", "fields"), CASES, ids=str)
def test_it_acts_as_a_direct_computation_and_alone_as_in_a_batch(
    kind: str, lstm: bool, fields: dict[str, Any], tmp_path: Path
) -> None:
    numbers = SmallNetwork(WIDTH, lstm)
    file = network(kind, tmp_path / "policy", numbers)
    description = make_spec(file, action_clip=(-0.8, 0.8), observation_clip=0.9, **fields)
    policy, rows = NetworkPolicy(description), walk()
    found = acted(policy, rows, restarts=True)
    directs = [Direct(description, numbers.make_act()) for _ in range(ROBOTS)]
    for step, observation in enumerate(rows):
        for robot in np.flatnonzero(restarted(step)):
            directs[robot] = Direct(description, numbers.make_act())
        expected = [direct.targets(seen) for direct, seen in zip(directs, observation, strict=True)]
        np.testing.assert_allclose(found[step], expected, atol=1e-6, rtol=0.0)
    assert np.ptp(found, axis=0).max() > 0.01
    alone = acted(policy, rows[:, :1])
    np.testing.assert_array_equal(alone, found[:, :1])
    np.testing.assert_array_equal(acted(policy, np.repeat(rows, 5, axis=1))[:, ::5][:, :1], alone)


@pytest.mark.parametrize("period", [0.01, 0.012, 0.015, 0.02, 0.0333])
def test_each_target_is_held_until_the_next_at_any_period(period: float, tmp_path: Path) -> None:
    file = SmallNetwork(3).onnx(tmp_path / "policy.onnx")
    policy = NetworkPolicy(make_spec(file, (SpecTerm("command"),), control_rate=1.0 / period))
    rows = np.zeros((STEPS, 1, OBSERVATION["command"].stop), np.float32)
    rows[:, :, OBSERVATION["command"]] = np.linspace(-1.0, 1.0, STEPS)[:, None, None]
    actions = acted(policy, rows)[:, 0]
    changed = [step for step in range(STEPS) if step == 0 or (actions[step] != actions[step - 1]).any()]
    expected, instant = [], 0.0
    while (step := int(np.ceil(instant / 0.01 - 1e-9))) < STEPS:
        expected.append(step)
        instant += period
    assert changed == expected


def test_joints_that_turn_the_other_way_or_are_zero_elsewhere(tmp_path: Path) -> None:
    signs = tuple(-1.0 if "hip" not in name else 1.0 for name in JOINTS)
    zeros = tuple((0.1 + np.arange(12) / 50).tolist())
    terms = (SpecTerm("joint_position"), SpecTerm("joint_velocity"))
    plain = make_spec(SmallNetwork(24).onnx(tmp_path / "policy.onnx"), terms, control_rate=100.0)
    turned = replace(plain, signs=signs, zeros=zeros)
    row = np.zeros((1, 1, OBSERVATION["command"].stop), np.float32)
    row[..., OBSERVATION["joint_position"]] = np.linspace(-0.02, 0.02, 12)
    row[..., OBSERVATION["joint_velocity"]] = np.linspace(-0.5, 0.5, 12)
    sign, zero, default = (dict(zip(JOINTS, each, strict=True)) for each in (signs, zeros, plain.default_position))
    angles = row[0, 0, OBSERVATION["joint_position"]] + SIMPLE_QUAD.home_pose
    rates = row[0, 0, OBSERVATION["joint_velocity"]]
    seen = [sign[name] * (angles[place(name)] - zero[name]) - default[name] for name in OBSERVED]
    seen += [sign[name] * rates[place(name)] for name in OBSERVED]
    action = SmallNetwork(24).make_act()(np.array(seen, np.float32))
    expected = np.zeros(12)
    for name, scale, value in zip(JOINTS, plain.action_scale, action, strict=True):
        expected[place(name)] = zero[name] + sign[name] * (default[name] + scale * value)
    expected = np.clip(expected, SIMPLE_QUAD.joint_lower, SIMPLE_QUAD.joint_upper)
    np.testing.assert_allclose(acted(NetworkPolicy(turned), row)[0, 0], expected, atol=1e-5)
    with pytest.raises(PolicyError, match="`signs` must be 1 or -1"):
        replace(plain, signs=(0.5,) * 12)


def test_its_robot_has_the_gains_of_the_description_joint_by_joint(tmp_path: Path) -> None:
    description = make_spec(SmallNetwork(WIDTH).onnx(tmp_path / "policy.onnx"))
    robot = NetworkPolicy(description).robot
    for joint, stiffness, damping in zip(JOINTS, description.stiffness, description.damping, strict=True):
        assert robot.servo_stiffness[place(joint)] == stiffness
        assert robot.servo_damping[place(joint)] == damping


@pytest.mark.parametrize("previous", ["raw", "scaled"])
def test_targets_are_about_the_offset_of_the_actions_where_that_is_not_the_default_position(
    previous: Any, tmp_path: Path
) -> None:
    """The first targets, before any action, differ from the default position by the action offset, joint by joint."""
    file = SmallNetwork(WIDTH).onnx(tmp_path / "policy.onnx")
    offset = tuple(0.01 * (number + 1) + each for number, each in enumerate(make_spec(file).default_position))
    plain, shifted = (
        NetworkPolicy(make_spec(file, action_offset=each, previous_action=previous)) for each in (None, offset)
    )
    rows = walk(2)
    first, other = plain.act(rows[0][:1])[0], shifted.act(rows[0][:1])[0]
    by_hand = np.zeros(12)
    for number, joint in enumerate(JOINTS):
        by_hand[place(joint)] = 0.01 * (number + 1)
    np.testing.assert_allclose(other - first, by_hand, atol=1e-6)
    np.testing.assert_allclose(shifted._adapter.action, plain._adapter.action, atol=1e-6)


def test_targets_are_limited_in_the_policys_terms(tmp_path: Path) -> None:
    limits = tuple((-0.05 + low, 0.05 + low) for low in make_spec(tmp_path).default_position)
    file = SmallNetwork(WIDTH).onnx(tmp_path / "policy.onnx")
    free, held = (NetworkPolicy(make_spec(file, target_clip=clip)) for clip in (None, limits))
    places = [place(joint) for joint in JOINTS]
    rows = 5.0 * walk()
    expected = np.clip(acted(free, rows)[0][:, places], *np.transpose(limits))
    np.testing.assert_allclose(acted(held, rows)[0][:, places], expected, atol=1e-6)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"control_rate": 200.0}, "acts at 200 Hz, more often than the environment's 100 Hz"),
        (
            {"terms": (*MIXED[:-1], replace(MIXED[-1], history=2))},
            r"reads 135 numbers and .* gives 123: .*action 12 x 2",
        ),
        ({"joints": tuple("abcdefghijkl"), "observed_joints": None}, "moves the joint 'a', which fits none"),
    ],
)
@pytest.mark.parametrize("kind", ["onnx", "torchscript"])
def test_what_does_not_fit_is_refused_in_words(kind: str, fields: dict[str, Any], words: str, tmp_path: Path) -> None:
    file = network(kind, tmp_path / "policy", SmallNetwork(WIDTH))
    with pytest.raises(PolicyError, match=words):
        NetworkPolicy(make_spec(file, **fields))
