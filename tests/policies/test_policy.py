from functools import partial

import gymnasium as gym
import numpy as np
import pytest

import policies
from policies.bundle import copy
from policies.history import Inputs
from policies.legs.kinematics import foot_positions
from policies.network import Network
from policies.residual import Features, ResidualPolicy
from policies.residual_bases import BASES
from quad_env import OBSERVATION, OBSERVATION_SIZE
from quad_env.robots.registry import get_robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.sensing.height_scan import HeightScan
from tests.robot_models import NEEDS_MODELS

BUNDLES = policies.shipped.MODELS
"""Folder of the trained policies that ship."""


def small_residual():
    """Return a residual policy with held corrections, history inputs and a clock."""
    base, inputs, rng = (
        policies.make("trot"),
        Inputs(lags=(0.02,), averages=(0.1,), clock=2.5),
        np.random.default_rng(5),
    )
    weights = rng.normal(0.0, 0.1, (Features(base, inputs).width, 12)).astype(np.float32)
    return ResidualPolicy(base, Network((weights,), (np.zeros(12, np.float32),)), inputs=inputs, hold=3)


MAKERS = {
    **{name: partial(policies.make, name) for name in ("bound", "crouch", "gaits", "pace", "pronk", "stand", "walk")},
    **{name: partial(policies.make, name) for name in ("behaviour", "document", "document_repaired", "safe:trot")},
    **{name: partial(policies.make, name) for name in ("trot", "trot_integral")},
    "trot_reference": partial(policies.make, "trot_reference", servo="own"),
    "residual": small_residual,
}
every_policy = pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS.keys())


def readings(steps, n):
    """Return observations (steps, n, k) with a command that jumps every 40 steps."""
    rng = np.random.default_rng(2)
    observations = rng.normal(size=(steps, n, OBSERVATION_SIZE)).astype(np.float32)
    commands = rng.uniform([-1.0, -0.8, -1.2], [1.5, 0.8, 1.2], (steps // 40 + 1, n, 3))
    observations[..., OBSERVATION["command"]] = np.repeat(commands, 40, axis=0)[:steps]
    return observations


def actions(policy, observations):
    policy.reset(observations.shape[1])
    return np.stack([policy.act(row) for row in observations])


@every_policy
def test_one_row_gets_the_same_targets_within_the_limits_alone_and_in_any_batch_after_a_reset(make):
    observations, policy = readings(45, 200), make()
    whole = actions(policy, observations)
    for first, count in ((0, 1), (199, 1), (11, 3), (136, 64)):
        part = actions(policy, np.ascontiguousarray(observations[:, first : first + count]))
        assert part.tobytes() == whole[:, first : first + count].tobytes()
    assert whole.dtype == np.float32
    assert whole.shape == (45, 200, 12)
    assert (whole >= SIMPLE_QUAD.joint_lower.astype(np.float32)).all()
    assert (whole <= SIMPLE_QUAD.joint_upper.astype(np.float32)).all()


@every_policy
def test_a_single_observation_gives_a_single_action_and_another_shape_is_refused(make):
    observation, policy = readings(1, 1)[0, 0], make()
    action = policy.act(observation)
    assert action.shape == (12,)
    policy.reset(1)
    assert action.tobytes() == policy.act(observation[None])[0].tobytes()
    for shape in ((OBSERVATION_SIZE + 1,), (2, OBSERVATION_SIZE), ()):
        with pytest.raises(ValueError, match="shape"):
            policy.act(np.zeros(shape, np.float32))


@every_policy
def test_reset_where_starts_the_masked_robots_anew_and_leaves_the_others(make):
    observations = readings(90, 5)
    mask = np.array([False, True, False, True, True])
    policy, undisturbed = make(), make()
    actions(policy, observations[:50]), actions(undisturbed, observations[:50])
    policy.reset_where(mask)
    later = np.stack([policy.act(row) for row in observations[50:]])
    expected = np.stack([undisturbed.act(row) for row in observations[50:]])
    fresh = actions(make(), observations[50:])
    assert later[:, ~mask].tobytes() == expected[:, ~mask].tobytes()
    assert later[:, mask].tobytes() == fresh[:, mask].tobytes()


def walk(steps, n, scan):
    """Return observations (steps, n, k) of trotting robots, with a height scan or None."""
    env, trot = gym.make_vec("SimpleQuad-v0", num_envs=n, nthread=1, height_scan=scan), policies.make("trot")
    observation, _ = env.reset(seed=0)
    trot.reset(n)
    seen = [observation]
    for _ in range(steps - 1):
        seen.append(env.step(trot.act(seen[-1][:, :OBSERVATION_SIZE]))[0])
    return np.stack(seen)


@pytest.mark.parametrize("name", BASES)
def test_robots_that_a_base_takes_over_go_on_as_they_would_have_and_leave_the_others(name):
    policy, restarted, fresh = (policies.make(name, sensors="typical", servo="own") for _ in range(3))
    observations, mask = walk(40, 3, policy.height_scan), np.array([False, True, False])
    actions(policy, observations[:20]), actions(restarted, observations[:20])
    restarted.reset_where(mask)
    expected = [restarted.act(observations[20])]
    policy.act(np.where(mask[:, None], observations[0], observations[20]))  # the last observation of the episode
    first = actions(fresh, observations[20:21, mask])
    policy.copy_state_from(mask, fresh)
    assert first[0].tobytes() == expected[0][mask].tobytes()
    for row in observations[21:]:
        assert policy.act(row).tobytes() == restarted.act(row).tobytes()


@every_policy
def test_actions_handed_out_are_never_written_to_again(make):
    policy, observations = make(), readings(3, 2)
    policy.reset(2)
    first = policy.act(observations[0])
    kept = first.copy()
    policy.act(observations[1])
    first[:] = 7.0
    later = policy.act(observations[2])
    assert np.abs(kept).max() < 7.0
    assert np.abs(later).max() < 7.0


@every_policy
def test_non_finite_observation_is_refused_and_moves_no_clock(make):
    policy, untouched = make(), make()
    bad = np.zeros(OBSERVATION_SIZE, np.float32)
    for bad[3] in (np.nan, np.inf):
        with pytest.raises(ValueError, match="finite"):
            policy.act(bad)
    assert policy.act(np.zeros_like(bad)).tobytes() == untouched.act(np.zeros_like(bad)).tobytes()


@pytest.mark.parametrize("mask", [[True], [1, 0, 0], [[True, False, False]]])
def test_wrong_reset_mask_is_refused(mask):
    policy = policies.make("trot")
    policy.reset(3)
    with pytest.raises(ValueError, match="mask"):
        policy.reset_where(np.array(mask))


def test_batch_of_none_is_refused():
    with pytest.raises(ValueError, match="num_envs"):
        policies.make("trot").reset(0)


def test_stand_holds_the_home_pose():
    action = policies.make("stand").act(readings(1, 1)[0, 0])
    np.testing.assert_array_equal(action, SIMPLE_QUAD.home_pose.astype(np.float32))


def test_crouch_puts_its_feet_under_the_thigh_joints():
    policy = policies.make("crouch")
    np.testing.assert_array_equal(policy.act(readings(1, 1)[0, 0]), policy.pose.astype(np.float32))
    feet = foot_positions(SIMPLE_QUAD, policy.pose.reshape(4, 3))
    side = SIMPLE_QUAD.side
    expected = np.stack([0.0 * side, SIMPLE_QUAD.hip_offset * side, np.full(4, -0.62 * 0.6)], axis=-1)
    np.testing.assert_allclose(feet, expected, atol=1e-12)


def test_names_are_sorted_and_every_one_can_be_made():
    controllers = (
        "behaviour, bound, crouch, document, document_repaired, gaits, mpc, mpc_wbc, mpc_wbc_bound, "
        "mpc_wbc_pace, mpc_wbc_pronk, mpc_wbc_sighted, mpc_wbc_walk, pace, pronk, "
        "stand, trot, trot_feedback, trot_integral, trot_reference, walk"
    )
    bundles = {file.parent.name for file in policies.shipped.MODELS.glob("*/policy.json")}
    assert bundles
    assert list(policies.names()) == sorted({*controllers.split(", "), *bundles})
    for name in policies.names():
        assert policies.make(name, servo="own").name == name
        assert policies.resolve(name, servo="own").name == name


@pytest.mark.parametrize("name", ["student", "robust", "end_to_end"])
def test_a_robot_has_a_trained_policy_when_its_folder_ships(name, tmp_path, monkeypatch):
    monkeypatch.setattr(policies.shipped, "MODELS", tmp_path)
    assert policies.is_missing(name, SIMPLE_QUAD)
    assert name not in policies.names()
    with pytest.raises(policies.PolicyError, match=rf"no trained policy in .*{name}.*take one of behaviour, bound, .*"):
        policies.make(name)
    copy(BUNDLES / "residual", tmp_path / name)
    assert not policies.is_missing(name, SIMPLE_QUAD)
    assert policies.trained_names(SIMPLE_QUAD) == (name,)
    assert name in policies.names()
    assert policies.make(name, servo="own").name == policies.resolve(name, servo="own").name == name


@NEEDS_MODELS
def test_the_folder_of_a_robot_has_its_own_names_and_refuses_the_policy_of_another_robot(tmp_path, monkeypatch):
    monkeypatch.setattr(policies.shipped, "MODELS", tmp_path)
    for name, source in (("student", "go2/residual"), ("robust", "residual"), ("mine", "go2/residual")):
        copy(BUNDLES / source, tmp_path / "go2" / name)
    assert policies.trained_names(get_robot("go2")) == ("mine", "robust", "student")
    assert {"mine", "robust", "student"} <= set(policies.names("go2"))
    assert not {"mine", "robust", "student"} & set(policies.names())
    for name in ("student", "mine"):
        assert policies.make(name, robot="go2", servo="own").name == name
    with pytest.raises(policies.PolicyError, match=r"robust was made for simple_quad .*not for go2"):
        policies.make("robust", robot="go2", servo="own")
    with pytest.raises(policies.PolicyError, match=f"unknown policy 'mine'; there are {', '.join(policies.names())}$"):
        policies.make("mine")
    with pytest.raises(policies.PolicyError, match=f"gallop.*{', '.join(policies.names('go2'))}$"):
        policies.make("gallop", robot="go2")


@pytest.mark.parametrize("ask", [policies.make, policies.resolve])
def test_unknown_name_is_answered_with_the_valid_ones(ask):
    with pytest.raises(policies.PolicyError, match="gallop.*" + ", ".join(policies.names())):
        ask("gallop")


def test_missing_shipped_model_names_the_command_that_makes_one(tmp_path, monkeypatch):
    monkeypatch.setattr(policies.shipped, "MODELS", tmp_path)
    with pytest.raises(policies.PolicyError, match="python -m train"):
        policies.make("residual")


@pytest.mark.parametrize("name", [name for name in BASES if name != "mpc_wbc_sighted"])
def test_a_base_that_is_shown_a_scan_acts_as_without_also_where_a_robot_starts_again(name):
    scan = HeightScan(ahead=1, behind=0, aside=0)
    found = []
    for shown in (None, scan):
        policy = policies.make(name, height_scan=shown, servo="own")
        policy.reset(2)
        seen = readings(2, 2) if shown is None else np.pad(readings(2, 2), ((0, 0), (0, 0), (0, 2)))
        first = policy.act(seen[0])
        policy.reset_where(np.array([True, False]))
        found.append((first, policy.act(seen[1])))
    np.testing.assert_array_equal(*found)


def test_names_of_older_versions_still_work():
    """A reset of some robots calls `_restart` of a user's policy, and `check_fits` and `Foreign` still exist."""
    restarted = []

    class Mine(policies.Stand):
        def _restart(self, mask):
            super()._restart(mask)
            restarted.append(mask.tolist())

    policy = Mine()
    policy.reset(2)
    policy.reset_where(np.array([True, False]))
    assert restarted == [[True, False]]
    policy.check_fits(policy.robot, policy.control_period)
    with pytest.raises(ValueError, match="make it for its environment"):
        policy.check_fits(policy.robot, 0.5)
    assert policies.Foreign is policies.ExternalPolicy
