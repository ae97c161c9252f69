"""Fields of the settings of each kind reach the simulated robots."""

import pytest

from tests.quad_env.envs.effects.settings import FIELDS, check


@pytest.mark.parametrize("field", FIELDS)
def test_a_field_reaches_what_it_governs(field: str) -> None:
    """Of a robot of a batch; a robot alone has its bits, see `test_same_bits`."""
    check(field, FIELDS[field])
