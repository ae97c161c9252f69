import hashlib
import itertools
import math
from pathlib import Path

import numpy as np
import pytest

import policies
from policies.network import LIMIT, Network, activation_chords, fold_normalization, piece_index

MODELS = Path(__file__).parents[2] / "models"


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


def whole_products(network, inputs):
    """Return the outputs of a network by its definition, with each layer's sums in one product."""
    slopes, intercepts = activation_chords()
    values = np.clip(inputs, np.float32(-LIMIT), np.float32(LIMIT)).astype(np.float64)
    for index, (weight, bias) in enumerate(network._layers):
        if index:
            pieces = piece_index(values)
            # The grid is added to the intercept first, as the network does: two additions would round twice.
            values = values * slopes[pieces] + (intercepts[pieces] + GRID) - GRID
        else:
            values = (values + GRID) - GRID
        values = values @ weight + bias
    return values.astype(np.float32)


GRID = 1.5 * 2.0**32
"""Number that rounds a float64 to multiples of 2^-20 when it is added and subtracted again."""
EXTREMES = f32([0.0, -0.0, 64.0, -64.0, 1e-45, -1e-38, 3.4e38, -3.4e38, 2.0**-21, 1.5 * 2.0**-20, np.inf, -np.inf])


@pytest.mark.parametrize("hidden", [(256, 128, 64), (512, 256, 128), (1030,), (700, 33)])
@pytest.mark.parametrize("rows", [1, 2, 9, 31, 33, 128, 161])
def test_products_in_parts_have_the_bits_of_whole_products(hidden, rows):
    """The numbers of units and of robots include multiples of the size of a part, and numbers around them."""
    network, rng = random_network((389, *hidden, 12)), np.random.default_rng(rows)
    inputs = f32(rng.normal(0.0, 2.0, (rows, 389)))
    inputs = np.where(rng.random(inputs.shape) < 0.05, rng.choice(EXTREMES, inputs.shape), inputs)
    assert network(inputs).tobytes() == whole_products(network, inputs).tobytes()
    lost = np.where(rng.random((rows, 1)) < 0.5, np.float32(np.nan), inputs)
    np.testing.assert_array_equal(network(lost), whole_products(network, lost))


@pytest.mark.parametrize("bundle", sorted(path.parent for path in MODELS.rglob("policy.json")), ids=str)
def test_the_networks_of_shipped_bundles_have_the_bits_of_whole_products(bundle):
    network, rng = policies.load(bundle, servo="own").network, np.random.default_rng(5)
    for rows, scale in ((1, 1.0), (40, 3.0), (128, 100.0)):
        inputs = f32(rng.normal(0.0, scale, (rows, network.sizes[0])))
        assert network(inputs).tobytes() == whole_products(network, inputs).tobytes()


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
