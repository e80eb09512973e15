"""SigmoidCrossEntropyLoss."""

import numpy as np
import pytest

X = np.log([[1.0, 3], [1 / 3, 4]])  # probabilities 1/2 3/4 and 1/4 4/5
TARGET = [[1, 0.5], [0, 1]]


def text(options=""):
    return f'type: "SigmoidCrossEntropyLoss" loss_param {{ {options} }}'


def test_by_hand(run):
    """The loss is divided by the number of items, not of values; a target may be a probability."""
    done = run(text(), X, TARGET)
    costs = -np.log([1 / 2, 3 / 4, 4 / 5]).sum() - (np.log(3 / 4) + np.log(1 / 4)) / 2
    assert done.y == pytest.approx(costs / 2)
    [dx, _] = done.backward(4, wanted=[True, False])
    assert np.allclose(dx, [[-1, 0.5], [0.5, -0.4]])


@pytest.mark.parametrize(
    ("options", "divisor"),
    [("", 2), ("normalization: VALID", 5), ("normalization: FULL", 6), ("normalization: BATCH_SIZE", 2),
     ("normalization: NONE", 1), ("normalize: true", 5), ("normalize: false", 2),
     ("normalize: false normalization: FULL", 6)],
)
def test_normalization(run, rng, options, divisor):
    """The divisors agree for 2 items of 3 values with one ignored; BATCH_SIZE is the default of this layer only."""
    x, target = rng.normal(size=(2, 3)), np.array([[0, 1, -1], [0.25, 1, 0]])
    total, gradient = 0.0, np.zeros((2, 3))
    for at in np.ndindex(2, 3):
        p = 1 / (1 + np.exp(-x[at]))
        if target[at] != -1:
            total -= target[at] * np.log(p) + (1 - target[at]) * np.log(1 - p)
            gradient[at] = p - target[at]
    done = run(text(f"ignore_label: -1 {options}"), x, target)
    assert done.y == pytest.approx(total / divisor)
    assert np.allclose(done.backward(2, wanted=[True, False])[0], 2 * gradient / divisor)


def test_the_fraction_of_a_target_is_cut_before_it_is_compared(run):
    """A target of 0.5 is truncated to 0 and ignored with ignore_label: 0, as in Caffe."""
    done = run(text("ignore_label: 0"), X, TARGET)
    assert done.y == pytest.approx(-(np.log(1 / 2) + np.log(4 / 5)) / 2)
    [dx, _] = done.backward(1, wanted=[True, False])
    assert np.allclose(dx, [[-0.25, 0], [0, -0.1]])


def test_all_ignored(run):
    """If all targets are ignored, the loss and the gradient are 0."""
    done = run(text("ignore_label: 1 normalization: VALID"), X, np.ones((2, 2)))
    assert done.y == 0
    assert not done.backward(1, wanted=[True, False])[0].any()


def test_far_out(run):
    """For large scores a correct target has loss 0 and a wrong one the score's magnitude, without overflow."""
    done = run(text(), [[1000.0, -1000, 1000, -1000]], [[1.0, 0, 0, 1]])
    assert done.y == 2000
    assert done.backward(1, wanted=[True, False])[0].tolist() == [[0, 0, 1, -1]]
