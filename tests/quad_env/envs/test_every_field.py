"""Fields of every kind of settings affect the simulated robots."""

import pytest

from tests.quad_env.envs.effects.settings import FIELDS, check


@pytest.mark.parametrize("field", FIELDS)
def test_a_field_reaches_what_it_governs(field: str) -> None:
    """The robot is one of a batch; a single robot has the same bits, see `test_same_bits`."""
    check(field, FIELDS[field])
