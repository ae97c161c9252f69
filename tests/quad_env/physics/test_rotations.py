"""Cross products have the bits of NumPy's."""

import numpy as np

from quad_env.physics.rotations import cross, skew


def test_cross_products_have_the_bits_of_numpy_s_in_any_shape_and_are_those_of_the_matrices() -> None:
    a, b = np.random.default_rng(0).normal(size=(2, 5, 4, 3))
    np.testing.assert_array_equal(cross(a, b), np.cross(a, b))
    np.testing.assert_array_equal(cross(a[:, :1], b), np.cross(a[:, :1], b))
    np.testing.assert_allclose(cross(a, b), (skew(a) @ b[..., None])[..., 0], atol=1e-14)
