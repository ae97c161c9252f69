import numpy as np
import pytest

from policies.gait_cycle import WALK_OFFSETS, Gait
from tests.policies.gaits.strides import duty_factors, landing_offsets, landings, wrapped


def stepping(duty, offsets=WALK_OFFSETS):
    """Return contacts, cycle positions, duty factors and clock phases of a gait with 40 control steps a cycle."""
    phase = 2.0 * np.pi * (np.arange(1000) + 0.5) / 40.0
    contacts = ~Gait(offsets, duty).legs(phase).swing
    return contacts, (phase[:, None] + np.array(offsets)) / (2.0 * np.pi) % 1.0, np.full(1000, duty), phase


@pytest.mark.parametrize("duty", [0.4, 0.75])
def test_a_gaits_own_contacts_have_its_duty_and_its_offsets(duty):
    contacts, cycles, duties, phase = stepping(duty)
    np.testing.assert_allclose(duty_factors(contacts), duty, atol=1e-9)
    landed = landings(contacts, cycles, duties)
    assert (landed[40:].sum(axis=0) == 24).all()
    beside = wrapped(landing_offsets(landed, phase) - [0.0, 0.5, 0.25, 0.75])
    np.testing.assert_allclose(beside, 0.0, atol=1e-9)


def test_a_foot_that_lands_late_is_behind_by_that_and_a_bounce_in_its_stance_is_no_landing():
    contacts, cycles, duties, phase = stepping(0.5, (0.0,) * 4)
    contacts[20::40, 1] = False  # one control step late: 1/40 of a cycle
    contacts[30::40, 2] = False
    contacts[:, 3] = False
    offsets = landing_offsets(landings(contacts, cycles, duties), phase)
    np.testing.assert_allclose(offsets[:3], [0.0, -0.025, 0.0], atol=1e-9)
    assert np.isnan(offsets[3])
