"""Embed."""

import numpy as np
import pytest

pytestmark = pytest.mark.both_engines

TABLE = [[1.0, 2], [3, 4], [5, 6]]


def text(options=""):
    """Return a layer with three vectors of two numbers."""
    return f'type: "Embed" embed_param {{ num_output: 2 input_dim: 3 weight_filler {{ type: "gaussian" }} {options} }}'


def test_by_hand(run):
    """Each index selects a vector; the gradients of a repeated vector are added."""
    done = run(text(), [2, 0, 2], params=[TABLE, [10, 20]])
    assert done.y.tolist() == [[15, 26], [11, 22], [15, 26]]
    done.backward([[1, 2], [3, 4], [10, 20]], wanted=[False])
    assert done.layer.blobs[0].diff.tolist() == [[3, 4], [0, 0], [11, 22]]
    assert done.layer.blobs[1].diff.tolist() == [14, 26]


def test_it_is_inner_product_on_one_hot_vectors(run, rng):
    """The result equals that of InnerProduct on one-hot vectors with transposed weights."""
    index, w, b = rng.integers(0, 3, (4, 5)), rng.normal(size=(3, 2)), rng.normal(size=2)
    one_hot = np.eye(3)[index]
    mine = run(text(), index, params=[w, b])
    other = run('type: "InnerProduct" inner_product_param { num_output: 2 axis: 2 }', one_hot, params=[w.T, b])
    assert mine.y.shape == (4, 5, 2)
    assert np.allclose(mine.y, other.y)
    dy = rng.normal(size=mine.y.shape)
    mine.backward(dy, wanted=[False])
    other.backward(dy)
    assert np.allclose(mine.layer.blobs[0].diff, other.layer.blobs[0].diff.T)
    assert np.allclose(mine.layer.blobs[1].diff, other.layer.blobs[1].diff)
