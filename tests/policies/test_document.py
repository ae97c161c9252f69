import math

import numpy as np
import pytest

import policies
from policies.article import Document, PrintedGait, printed_joint_angles
from quad_env import OBSERVATION_SIZE
from quad_env.robots.simple_quad import SIMPLE_QUAD

# φ -> fl, fr, hl, hr, each hip, thigh, calf: the reference values of the project.
REFERENCE = {
    0.0: [
        (0.531808096948, -2.900116590832, -2.263849408375),
        (-0.540419500271, -2.711817222285, -2.282041790981),
        (0.540419500271, -2.711817222285, -2.282041790981),
        (-0.531808096948, -2.900116590832, -2.263849408375),
    ],
    math.pi / 2: [
        (0.982793723247, -2.974144574370, -2.806696495150),
        (-0.531808096948, -2.900116590832, -2.263849408375),
        (0.531808096948, -2.900116590832, -2.263849408375),
        (-0.982793723247, -2.974144574370, -2.806696495150),
    ],
    1.0: [
        (0.875642249590, -3.077286593868, -2.721491158340),
        (-0.536878867807, -2.834756305549, -2.274634882332),
        (0.536878867807, -2.834756305549, -2.274634882332),
        (-0.875642249590, -3.077286593868, -2.721491158340),
    ],
    4.0: [
        (0.537803729154, -2.817949723929, -2.276579373741),
        (-0.825776293121, -3.073560097421, -2.676236307504),
        (0.825776293121, -3.073560097421, -2.676236307504),
        (-0.537803729154, -2.817949723929, -2.276579373741),
    ],
}


@pytest.mark.parametrize("phase", REFERENCE)
def test_targets_equal_the_reference_table(phase):
    targets = policies.make("document").targets(phase)
    np.testing.assert_allclose(targets, np.ravel(REFERENCE[phase]), atol=1e-9, rtol=0.0)


def test_array_of_phases_gives_the_scalar_answers():
    phases = np.linspace(0.0, 6.2, 24).reshape(2, 3, 4)
    targets = Document().targets(phases)
    assert targets.shape == (2, 3, 4, 12)
    assert targets.dtype == np.float64
    for index in np.ndindex(phases.shape):
        assert np.array_equal(targets[index], Document().targets(phases[index]))


def test_an_unreachable_foot_is_answered_with_zeros_and_the_limit_of_reach_with_numbers():
    feet = np.array([(0.0, 0.15, -0.6000001), (0.5, 0.0, 0.5), (0.0, 0.15, -0.6), (0.0, 0.15, 0.0)])
    found = printed_joint_angles(SIMPLE_QUAD, feet)
    assert not found[:2].any()
    assert found[2].any()
    assert np.isfinite(found).all()


def test_the_printed_figures_ask_for_no_foot_out_of_reach():
    feet = PrintedGait().feet(SIMPLE_QUAD, np.linspace(0.0, 2.0 * math.pi, 400), stance_start=0.0)
    assert printed_joint_angles(SIMPLE_QUAD, feet).any(axis=-1).all()


def test_first_action_is_that_of_one_tick_clipped_by_the_joint_limits():
    policy = policies.make("document")
    action = policy.act(np.zeros(OBSERVATION_SIZE, np.float32))
    phase = 2.0 * math.pi * 2.0 * 0.01
    assert policy.phase == pytest.approx([phase])
    expected = np.clip(policy.targets(phase), SIMPLE_QUAD.joint_lower, SIMPLE_QUAD.joint_upper)
    np.testing.assert_allclose(action, expected, atol=1e-6)
    assert action[1] == np.float32(-1.5)  # the printed pitch is -2.9 rad: the thigh is at its limit
