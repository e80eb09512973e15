"""InfogainLoss."""

import numpy as np
import pytest

from netlib.proto import binaryproto

X = np.log([[1.0, 2, 5], [4, 2, 2]])  # probabilities 1/8 2/8 5/8 and 4/8 2/8 2/8
H = [[1, 0, 0], [0, 1, 0], [0.5, 0, 2]]


def text(options="", axis=1):
    return f'type: "InfogainLoss" infogain_loss_param {{ axis: {axis} }} loss_param {{ {options} }}'


def by_loops(x, labels, H, ignore=None):
    """Return the loss summed over labels and classes, and its gradient, for x of shape (N, K, places)."""
    total, dx = 0.0, np.zeros_like(x)
    for n, place in np.ndindex(labels.shape):
        p = np.exp(x[n, :, place]) / np.exp(x[n, :, place]).sum()
        label = int(labels[n, place])
        for k in range(len(p)) if label != ignore else ():
            total -= H[label, k] * np.log(p[k])
            dx[n, :, place] += H[label, k] * (p - np.eye(len(p))[k])
    return total, dx


def test_by_hand(run):
    """The loss weights the classes with the label's row of H; the gradient is (p sum(row) - row) / 2."""
    done = run(text(), X, [2, 0], H)
    assert done.y == pytest.approx(-(0.5 * np.log(1 / 8) + 2 * np.log(5 / 8) + np.log(1 / 2)) / 2)
    [dx, _, _] = done.backward(4, wanted=[True, False, False])
    assert np.allclose(dx, [[2 * (2.5 / 8 - 0.5), 2 * 5 / 8, 2 * (12.5 / 8 - 2)], [-1, 0.5, 0.5]])


@pytest.mark.parametrize(
    ("options", "divisor"),
    [("", 3), ("normalization: VALID", 3), ("normalization: FULL", 4), ("normalization: BATCH_SIZE", 2),
     ("normalization: NONE", 1)],
)
def test_against_loops(run, rng, options, divisor):
    """Loss and gradient agree with loops for each normalization, with an ignored label and H as (1, 1, K, K)."""
    x, labels, H = rng.normal(size=(2, 3, 2)), np.array([[0, 1], [9, 2]]), rng.normal(size=(3, 3))
    total, gradient = by_loops(x, labels, H, ignore=9)
    done = run(text(f"ignore_label: 9 {options}"), x, labels, H.reshape(1, 1, 3, 3))
    assert done.y == pytest.approx(total / divisor)
    assert np.allclose(done.backward(2, wanted=[True, False, False])[0], 2 * gradient / divisor)


def test_classes_on_another_axis(run, rng):
    x, labels, H = rng.normal(size=(2, 3, 4)), rng.integers(0, 3, (2, 4)), rng.normal(size=(3, 3))
    first = run(text(), x, labels, H, tops=2)
    last = run(text(axis=-1), np.moveaxis(x, 1, 2), labels, H, tops=2)
    assert last.y == pytest.approx(first.y)
    assert np.allclose(first.ys[1], np.exp(x) / np.exp(x).sum(axis=1, keepdims=True))
    assert np.allclose(last.ys[1], np.moveaxis(first.ys[1], 1, 2))
    dx, dx_last = (done.backward(1, wanted=[True, False, False])[0] for done in (first, last))
    assert np.allclose(dx_last, np.moveaxis(dx, 1, 2))


def test_an_impossible_label_costs_a_lot_but_not_infinity(run):
    """Probabilities are at least 1e-20, so the loss is finite."""
    assert run(text(), [[1000.0, 0]], [1], np.eye(2)).y == pytest.approx(-np.log(1e-20))


def test_h_from_a_file(run, tmp_path, monkeypatch):
    """A .binaryproto with K * K values in any shape is equivalent to a third bottom."""
    monkeypatch.chdir(tmp_path)
    binaryproto.write_blob(np.float32(H).reshape(1, 1, 3, 3), "H.binaryproto")
    from_file = run('type: "InfogainLoss" infogain_loss_param { source: "H.binaryproto" }', X, [2, 0])
    assert from_file.y == run(text(), X, [2, 0], np.float32(H)).y


def test_a_source_is_not_looked_at_where_h_is_a_bottom(run):
    """``source`` is ignored if H is a bottom, as in Caffe."""
    done = run('type: "InfogainLoss" infogain_loss_param { source: "none" }', X, [2, 0], H)
    assert done.y == run(text(), X, [2, 0], H).y
