import hashlib
import itertools
import math

import numpy as np
import pytest

from policies.network import LIMIT, Network, activation_chords, fold_normalization, piece_index


def random_network(sizes=(62, 128, 128, 12)):
    rng = np.random.default_rng(3)
    shapes = itertools.pairwise(sizes)
    weights = tuple(rng.normal(0.0, shape[0] ** -0.5, shape).astype(np.float32) for shape in shapes)
    return Network(weights, tuple(rng.normal(size=size).astype(np.float32) for size in sizes[1:]))


def f32(values):
    return np.array(values, dtype=np.float32)


def test_forward_pass_by_hand():
    hidden = math.exp(-0.5) - 1.0
    # Hidden unit: 1·2 + 3·(-1) + 0.5 = -0.5; output: 4·hidden + 1, without an activation after the last layer.
    network = Network((f32([[2.0], [-1.0]]), f32([[4.0]])), (f32([0.5]), f32([1.0])))
    np.testing.assert_allclose(network(f32([[1.0, 3.0]])), [[4.0 * hidden + 1.0]], atol=4e-6)


def test_a_row_has_the_same_bits_in_any_batch():
    network = random_network((302, 128, 128, 12))
    inputs = np.random.default_rng(4).normal(size=(300, 302)).astype(np.float32)
    whole = network(inputs)
    for n in (1, 3, 16, 17, 128, 129):
        assert network(inputs[:n]).tobytes() == whole[:n].tobytes()
    assert network(inputs[277:278]).tobytes() == whole[277:278].tobytes()


def test_the_activation_is_within_3e_7_of_its_function():
    slopes, intercepts = activation_chords()
    x = np.concatenate([sign * np.logspace(-8.0, np.log10(LIMIT), 20_000, endpoint=False) for sign in (1.0, -1.0)])
    np.testing.assert_allclose(
        slopes[piece_index(x)] * x + intercepts[piece_index(x)],
        np.maximum(x, 0.0) + np.expm1(np.minimum(x, 0.0)),
        atol=3e-7,
    )


def test_the_pieces_of_the_activation_have_the_same_bits_everywhere():
    found = hashlib.sha256(b"".join(each.tobytes() for each in activation_chords())).hexdigest()
    assert found == "43a7d95ce985d29cdc000bc542a064c3c3165135fc96363acc84d64346fac24c"


def test_inputs_beyond_the_limit_are_clipped_and_nan_stays_nan():
    network = random_network()
    at_limit = network(np.full((1, 62), 64.0, np.float32))
    np.testing.assert_array_equal(network(np.full((1, 62), np.inf, np.float32)), at_limit)
    assert np.isnan(network(np.full((1, 62), np.nan, np.float32))).all()


def test_the_largest_weights_of_a_bundle_give_finite_numbers():
    sizes = (62, *(16,) * 8, 12)
    weights = tuple(np.full(shape, 1e6, np.float32) for shape in itertools.pairwise(sizes))
    network = Network(weights, tuple(np.full(size, -1e6, np.float32) for size in sizes[1:]))
    assert np.isfinite(network(np.full((1, 62), 1e10, np.float32))).all()


def test_sums_are_exact():
    # 2000 large products and their opposites cancel to the bit, and 2^-20 · 1 remains.
    rng = np.random.default_rng(7)
    weights, inputs = rng.normal(size=2000), rng.uniform(-64.0, 64.0, (200, 2000))
    network = Network((f32([*weights, *-weights, 1.0])[:, None],), (f32([0.0]),))
    seen = np.concatenate([inputs, inputs, np.full((200, 1), 2.0**-20)], axis=1)
    np.testing.assert_array_equal(network(f32(seen)), np.float32(2.0**-20))


@pytest.mark.parametrize(
    ("weights", "biases"),
    [
        ((), ()),
        ((f32([[1.0]]), f32([[1.0], [1.0]])), (f32([0.0]), f32([0.0]))),
        ((np.array([[1.0]]),), (f32([0.0]),)),
    ],
    ids=["no layers", "layer widths", "float64"],
)
def test_layers_that_do_not_fit_are_refused(weights, biases):
    with pytest.raises(ValueError, match=r"layer|float32"):
        Network(weights, biases)


def test_a_folded_normalization_gives_the_output_for_normalized_inputs():
    network, rng = random_network(), np.random.default_rng(1)
    mean, std = rng.normal(size=62), rng.uniform(0.05, 3.0, 62)
    seen = f32(mean + std * rng.normal(size=(50, 62)))
    expected = network(f32((seen - mean) / std))
    found = fold_normalization(network, mean, std)
    np.testing.assert_allclose(found(seen), expected, atol=1e-6 * np.abs(expected).max(), rtol=1e-5)
    assert np.abs(network(seen) - expected).max() > 0.1, "or this shows nothing"
