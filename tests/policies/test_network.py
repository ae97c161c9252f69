import itertools
import math

import numpy as np
import pytest

from policies.network import Network


def random_network(activation="tanh", sizes=(62, 128, 128, 12)):
    rng = np.random.default_rng(3)
    shapes = itertools.pairwise(sizes)
    weights = tuple(rng.normal(0.0, shape[0] ** -0.5, shape).astype(np.float32) for shape in shapes)
    return Network(weights, tuple(rng.normal(size=size).astype(np.float32) for size in sizes[1:]), activation)


def f32(values):
    return np.array(values, dtype=np.float32)


@pytest.mark.parametrize(("activation", "hidden"), [("tanh", math.tanh(-0.5)), ("elu", math.exp(-0.5) - 1.0)])
def test_forward_pass_by_hand(activation, hidden):
    # Hidden unit: 1·2 + 3·(-1) + 0.5 = -0.5; output: 4·hidden + 1, with no activation after the last layer.
    network = Network((f32([[2.0], [-1.0]]), f32([[4.0]])), (f32([0.5]), f32([1.0])), activation)
    np.testing.assert_allclose(network(f32([[1.0, 3.0]])), [[4.0 * hidden + 1.0]], rtol=1e-6)


@pytest.mark.parametrize("activation", ["tanh", "elu"])
def test_a_row_has_the_same_bits_in_any_batch(activation):
    network = random_network(activation)
    inputs = np.random.default_rng(4).normal(size=(1000, 62)).astype(np.float32)
    whole = network(inputs)
    for n in (1, 2, 3, 64, 512):
        assert network(inputs[:n]).tobytes() == whole[:n].tobytes()
    assert network(inputs[777:778]).tobytes() == whole[777:778].tobytes()


def test_outputs_agree_with_the_plain_matrix_product():
    network = random_network()
    inputs = np.random.default_rng(6).normal(size=(9, 62)).astype(np.float32)
    (w0, w1, w2), (b0, b1, b2) = network.weights, network.biases
    expected = np.tanh(np.tanh(inputs @ w0 + b0) @ w1 + b1) @ w2 + b2
    np.testing.assert_allclose(network(inputs), expected, atol=1e-5)


@pytest.mark.parametrize(
    ("weights", "biases", "activation"),
    [
        ((f32([[1.0]]),), (f32([0.0]),), "relu6"),
        ((), (), "tanh"),
        ((f32([[1.0]]),), (f32([0.0, 0.0]),), "tanh"),
        ((f32([[1.0]]), f32([[1.0], [1.0]])), (f32([0.0]), f32([0.0])), "tanh"),
        ((np.array([[1.0]]),), (f32([0.0]),), "tanh"),
    ],
    ids=["activation", "no layers", "bias width", "layer widths", "float64"],
)
def test_layers_that_do_not_fit_are_refused(weights, biases, activation):
    with pytest.raises(ValueError, match=r"activation|layer|float32"):
        Network(weights, biases, activation)
