"""SoftmaxWithLoss."""

import numpy as np
import pytest

X = np.log([[1.0, 2, 5], [4, 2, 2]])  # probabilities 1/8 2/8 5/8 and 4/8 2/8 2/8


def text(options=""):
    return f'type: "SoftmaxWithLoss" loss_param {{ {options} }}'


def test_by_hand(run):
    """Labels 2 and 0 give -(log 5/8 + log 1/2) / 2 and the gradient (p - label) / 2 times the weight."""
    done = run(text(), X, [2, 0])
    assert done.y == pytest.approx(-(np.log(5 / 8) + np.log(1 / 2)) / 2)
    [dx, _] = done.backward(4, wanted=[True, False])
    assert np.allclose(dx, 2 * np.array([[1 / 8, 2 / 8, -3 / 8], [-1 / 2, 1 / 4, 1 / 4]]))


def test_the_second_top_has_the_probabilities(run):
    done = run('type: "SoftmaxWithLoss"', X, [2, 0], tops=2)
    assert np.allclose(done.ys[1], np.exp(X) / 8)


@pytest.mark.parametrize(
    ("options", "divisor"),
    [("", 3), ("normalization: VALID", 3), ("normalization: FULL", 4), ("normalization: BATCH_SIZE", 2),
     ("normalization: NONE", 1), ("normalize: true", 3), ("normalize: false", 2),
     ("normalize: false normalization: FULL", 4)],
)
def test_normalization(run, rng, options, divisor):
    """The divisors agree for 2 items of 2 pixels with one ignored; ``normalization`` overrides ``normalize``."""
    x, labels = rng.normal(size=(2, 3, 2)), np.array([[0, 1], [9, 2]])
    logs = x - np.log(np.exp(x).sum(axis=1, keepdims=True))
    total = -(logs[0, 0, 0] + logs[0, 1, 1] + logs[1, 2, 1])
    done = run(text(f"ignore_label: 9 {options}"), x, labels)
    assert done.y == pytest.approx(total / divisor)
    [dx, _] = done.backward(1, wanted=[True, False])
    assert not dx[1, :, 0].any()


@pytest.mark.parametrize("shape", [(2, 4), (2, 1, 2, 2), (2, 2, 2), (2, 4, 1)])
def test_labels_may_have_other_axes_after_the_first(run, rng, shape):
    """Labels need only match in the number of items and values: scores (2, 3, 2, 2) take labels (2, 4), as in Caffe."""
    x, labels = rng.normal(size=(2, 3, 2, 2)), rng.integers(0, 3, (2, 2, 2))
    done, other = run(text(), x, labels.reshape(shape)), run(text(), x, labels)
    assert done.y == other.y
    assert np.array_equal(*(each.backward(1, wanted=[True, False])[0] for each in (done, other)))


def test_the_loss_of_no_labels_is_zero_without_sign(run):
    """If all labels are ignored the loss is 0, which the log shows as 0 and not as -0."""
    done = run('type: "SoftmaxWithLoss" loss_param { ignore_label: 1 }', np.ones((2, 3)), [1, 1])
    assert done.y == 0
    assert not np.signbit(done.y)


def test_an_impossible_label_costs_a_lot_but_not_infinity(run):
    """Probabilities are at least 2^-126, the smallest normal float, so the loss is finite."""
    assert run(text(), [[1000.0, 0]], [1]).y == pytest.approx(126 * np.log(2))
