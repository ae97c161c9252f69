"""Network inputs that consist of observation terms, each with a uniform history: layout, memory and bundle."""

import itertools
import json

import numpy as np
import pytest

import policies
from policies.bundle import DESCRIPTION, load, save
from policies.history import Inputs
from policies.input_terms import DEPLOYABLE_TERMS, TermInputs
from policies.network import Network
from policies.policy_stack import PolicyStack
from policies.residual import Features, ResidualPolicy
from quad_env import OBSERVATION, OBSERVATION_SIZE, SIMPLE_QUAD
from quad_env.sensing.height_scan import HeightScan
from quad_env.task.observations import observation_table
from tests.policies.test_bundle import rewrite

ACTION = np.zeros((2, 12), np.float32)
DEPLOYABLE = Inputs(terms=DEPLOYABLE_TERMS, history=4, clock=2.5)


def network(*sizes):
    rng = np.random.default_rng(7)
    weights = [rng.normal(0.0, 0.1, shape).astype(np.float32) for shape in itertools.pairwise(sizes)]
    return Network(tuple(weights), tuple(rng.normal(0.0, 0.1, size).astype(np.float32) for size in sizes[1:]))


def deployable_policy(hold=2, inputs=DEPLOYABLE):
    base = policies.make("stand")
    return ResidualPolicy(base, network(Features(base, inputs, hold).width, 16, 12), inputs=inputs, hold=hold)


def random_observations(steps, robots, seed=1):
    return np.random.default_rng(seed).normal(size=(steps, robots, OBSERVATION_SIZE)).astype(np.float32)


def inputs_by_hand(observations, step, inputs, hold, dt=0.01):
    """Return the network inputs of a robot at a control step, from its observations since the reset, (T, k)."""
    table = observation_table(SIMPLE_QUAD)
    moments = [step - age * hold if step >= age * hold else 0 for age in reversed(range(inputs.history))]
    parts = []
    for name in inputs.terms:
        columns = table.slices[name]
        parts += [observations[moment, columns] * table.scale[columns] for moment in moments]
    phases = [2.0 * np.pi * inputs.clock * dt * (moment + 1) for moment in moments]
    if inputs.clock:
        parts += [np.array([np.sin(phase), np.cos(phase)], np.float32) for phase in phases]
    return np.concatenate(parts)


@pytest.mark.parametrize("hold", [1, 2, 3])
def test_inputs_are_the_last_values_of_each_term_at_the_rate_of_the_policy_oldest_first(hold):
    inputs = Inputs(terms=("command", "angular_velocity"), history=3, clock=2.0)
    features = Features(policies.make("stand"), inputs, hold)
    features.reset(1)
    observations = random_observations(12, 1)
    assert features.width == 3 * (3 + 3 + 2)
    for step in range(12):
        row = features.update(observations[step], ACTION[:1])
        np.testing.assert_allclose(row[0], inputs_by_hand(observations[:, 0], step, inputs, hold), atol=1e-6)


def test_a_deployable_observation_has_no_linear_velocity():
    assert set(OBSERVATION) - set(DEPLOYABLE_TERMS) == {"linear_velocity"}


@pytest.mark.parametrize("hold", [1, 2])
def test_the_action_does_not_depend_on_the_linear_velocity(hold):
    policy, other = deployable_policy(hold), deployable_policy(hold)
    policy.reset(3), other.reset(3)
    observations = random_observations(30, 3)
    changed = observations.copy()
    changed[:, :, OBSERVATION["linear_velocity"]] += 5.0
    for seen, altered in zip(observations, changed, strict=True):
        assert policy.act(seen).tobytes() == other.act(altered).tobytes()


@pytest.mark.parametrize("term", DEPLOYABLE_TERMS)
def test_the_action_depends_on_every_other_term_and_on_its_history(term):
    policy, other = deployable_policy(1), deployable_policy(1)
    policy.reset(1), other.reset(1)
    observations = random_observations(6, 1)
    changed = observations.copy()
    changed[1, :, OBSERVATION[term]] += 1.0
    differs = [
        not np.array_equal(policy.act(seen), other.act(altered))
        for seen, altered in zip(observations, changed, strict=True)
    ]
    assert differs == [False, True, True, True, True, False]


def test_the_memory_of_a_robot_is_reset_alone():
    features, fresh = Features(policies.make("stand"), DEPLOYABLE, 2), Features(policies.make("stand"), DEPLOYABLE, 2)
    features.reset(2)
    observations = random_observations(14, 2)
    for step in range(7):
        features.update(observations[step], ACTION)
    features.reset_where(np.array([False, True]))
    fresh.reset(1)
    for step in range(7, 14):
        rows = features.update(observations[step], ACTION)
        alone = fresh.update(observations[step, 1:], ACTION[:1])
        assert rows[1].tobytes() == alone[0].tobytes()
        np.testing.assert_allclose(rows[0], inputs_by_hand(observations[:, 0], step, DEPLOYABLE, 2), atol=1e-6)


def test_the_memory_of_a_robot_is_copied_to_a_robot_of_another_batch():
    features, other = Features(policies.make("stand"), DEPLOYABLE, 2), Features(policies.make("stand"), DEPLOYABLE, 2)
    features.reset(2), other.reset(1)
    observations = random_observations(14, 2)
    for step in range(7):
        features.update(observations[step], ACTION)
    other.update(observations[6, 1:], ACTION[:1])
    features.copy_state_from(np.array([False, True]), other)
    for step in range(7, 14):
        rows = features.update(observations[step], ACTION)
        alone = other.update(observations[step, 1:], ACTION[:1])
        assert rows[1].tobytes() == alone[0].tobytes()


def test_a_robot_acts_in_every_batch_as_alone():
    observations = random_observations(25, 4)
    stack = PolicyStack([deployable_policy(), deployable_policy()])
    single, batch = deployable_policy(), deployable_policy()
    stack.reset(4), single.reset(1), batch.reset(4)
    for step in range(25):
        if step == 11:
            mask = np.array([False, False, True, True])
            batch.reset_where(mask), single.reset_where(mask[2:3])
        expected = single.act(observations[step, 2:3])
        if step < 11:
            assert stack.act(observations[step])[2].tobytes() == expected.tobytes()
        assert batch.act(observations[step])[2].tobytes() == expected.tobytes()


def test_a_bundle_records_the_layout_and_gives_the_same_bits(tmp_path):
    policy = deployable_policy()
    save(tmp_path, policy, {}, "unknown")
    found = load(tmp_path)
    assert (found.features.inputs, found.hold) == (DEPLOYABLE, 2)
    policy.reset(3), found.reset(3)
    for seen in random_observations(20, 3):
        assert found.act(seen).tobytes() == policy.act(seen).tobytes()
    layout = json.loads((tmp_path / DESCRIPTION).read_bytes())["network_inputs"]
    assert (layout["order"], layout["period"]) == ("oldest first", 0.02)
    assert [term["name"] for term in layout["terms"]] == [*DEPLOYABLE_TERMS, "gait_phase"]


def test_the_recorded_layout_is_sufficient_to_compute_the_network_inputs(tmp_path):
    """A runtime concatenates the last values of each term, scaled, in the order of the layout."""
    policy = deployable_policy()
    save(tmp_path, policy, {}, "unknown")
    layout = json.loads((tmp_path / DESCRIPTION).read_bytes())["network_inputs"]
    policy.reset(1)
    observations = random_observations(21, 1)
    frames = {term["name"]: [] for term in layout["terms"]}
    for step, seen in enumerate(observations):
        action = policy.act(seen)
        if step % 2:
            continue
        row = np.empty(policy.network.sizes[0], np.float32)
        for term in layout["terms"]:
            name, count = term["name"], term["history"]
            phase = layout["gait_phase"]["start"] + 2.0 * np.pi * layout["gait_phase"]["frequency"] * 0.01 * step
            value = np.array([np.sin(phase), np.cos(phase)]) if name == "gait_phase" else seen[0, OBSERVATION[name]]
            frames[name] = [*(frames[name] or [value] * count)[-count + 1 :], value]
            assert len(value) == term["width"]
            row[slice(*term["columns"])] = np.concatenate(frames[name]) * term["scale"]
        correction = policy.network(row[None]).clip(-1.0, 1.0)[0]
        targets = SIMPLE_QUAD.home_pose + policy.authority * correction
        limited = np.clip(targets, SIMPLE_QUAD.joint_lower, SIMPLE_QUAD.joint_upper)
        np.testing.assert_allclose(action[0], limited, atol=1e-5)


def test_a_bundle_with_another_layout_is_refused(tmp_path):
    save(tmp_path, deployable_policy(), {}, "unknown")
    layout = json.loads((tmp_path / DESCRIPTION).read_bytes())["network_inputs"]
    rewrite(tmp_path, network_inputs=layout | {"order": "newest first"}, description_sha256=None)
    with pytest.raises(policies.PolicyError, match="network_inputs differs"):
        load(tmp_path)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"history": 3}, "Inputs.history: history needs Inputs.terms, got 3"),
        ({"terms": ("command", "command")}, "Inputs.terms: a term is repeated, got command command"),
        ({"terms": ("mass",)}, "Inputs.terms"),
        ({"terms": ("command",), "lags": (0.02,)}, "Inputs.lags: must be empty with Inputs.terms, got 0.02"),
        ({"terms": ("command",), "averages": (0.2,)}, "Inputs.averages: must be empty with Inputs.terms, got 0.2"),
        ({"terms": ("command",), "position_error": 0.2}, "Inputs.position_error: must be 0 with Inputs.terms, got 0.2"),
        ({"terms": ("command",), "clock": 2.0, "clock_gain": 1.0}, "Inputs.clock_gain: must be 0 with Inputs.terms"),
    ],
)
def test_a_combination_of_inputs_without_meaning_is_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        Inputs(**settings)


@pytest.mark.parametrize("base", ["trot", "mpc_wbc_sighted"])
def test_a_base_policy_that_observes_is_refused(base):
    with pytest.raises(ValueError, match=f"Inputs.terms: the base policy must be a fixed pose, got {base}"):
        Features(policies.make(base), DEPLOYABLE)


def test_a_height_scan_is_refused():
    base = policies.make("stand", height_scan=HeightScan())
    with pytest.raises(ValueError, match=r"Inputs\.terms: .*height scan"):
        Features(base, DEPLOYABLE)


def test_a_history_that_is_too_long_is_refused():
    with pytest.raises(ValueError, match=r"Inputs\.history: .* got 10\.5 s; valid: at most 10 s"):
        TermInputs(SIMPLE_QUAD, Inputs(terms=("command",), history=22), 50, 0.01)
