"""Search of the recovery's poses and times."""

import numpy as np

from policies.behaviour.recovery import searched_parameters
from train.search.recovery import bounds, decoded, encoded


def test_search_encodes_and_decodes_the_parameters():
    found = searched_parameters()
    assert decoded(encoded(found)) == found
    low, high = bounds()
    assert len(low) == len(high) == len(encoded(found))
    assert (np.array(low) < np.array(high)).all()
