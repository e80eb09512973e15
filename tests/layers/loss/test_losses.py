"""Losses compared with loops, and what they read and refuse."""

import numpy as np
import pytest

from layers.loss import labels
from netlib.proto import binaryproto, prototxt, schema
from netlib.proto.messages import LossParameter


def by_loops(x, labels, H, ignore):
    """Return the loss summed over labels and classes, and its gradient, for x of shape
    (N, K, places).
    """
    total, dx = 0.0, np.zeros_like(x)
    for n, place in np.ndindex(labels.shape):
        p = np.exp(x[n, :, place]) / np.exp(x[n, :, place]).sum()
        label = int(labels[n, place])
        for k in range(len(p)) if label != ignore else ():
            total -= H[label, k] * np.log(p[k])
            dx[n, :, place] += H[label, k] * (p - np.eye(len(p))[k])
    return total, dx


@pytest.mark.parametrize(
    ("options", "divisor"),
    [
        ("", 3),
        ("normalization: FULL", 4),
        ("normalization: BATCH_SIZE", 2),
        ("normalization: NONE", 1),
    ],
)
@pytest.mark.parametrize("kind", ["InfogainLoss", "SoftmaxWithLoss"])
def test_labels_of_pixels_against_loops(run, rng, kind, options, divisor):
    """With an ignored label; H may have leading axes, and SoftmaxWithLoss is InfogainLoss
    with the identity.
    """
    x, labels = rng.normal(size=(2, 3, 2)), np.array([[0, 1], [9, 2]])
    H = rng.normal(size=(3, 3)) if kind == "InfogainLoss" else np.eye(3)
    total, gradient = by_loops(x, labels, H, ignore=9)
    more = [H.reshape(1, 1, 3, 3)] if kind == "InfogainLoss" else []
    done = run(f'type: "{kind}" loss_param {{ ignore_label: 9 {options} }}', x, labels, *more)
    assert done.y == pytest.approx(total / divisor)
    dx = done.backward(2, wanted=[True, False, False][: 2 + len(more)])[0]
    np.testing.assert_allclose(dx, 2 * gradient / divisor, atol=1e-12)


@pytest.mark.parametrize(
    ("kind", "options", "more"),
    [
        (
            "InfogainLoss",
            "infogain_loss_param { axis: -1 }",
            [np.random.default_rng(0).normal(size=(3, 3))],
        ),
        ("SoftmaxWithLoss", "softmax_param { axis: -1 }", []),
    ],
)
def test_classes_on_another_axis(run, rng, kind, options, more):
    x = rng.normal(size=(2, 3, 4))
    labels = rng.integers(0, 3, (2, 4))
    wanted = [True, False, False][: 2 + len(more)]
    first = run(f'type: "{kind}"', x, labels, *more, tops=2)
    last = run(f'type: "{kind}" {options}', np.moveaxis(x, 1, 2), labels, *more, tops=2)
    assert last.y == pytest.approx(first.y)
    assert np.allclose(first.ys[1], np.exp(x) / np.exp(x).sum(axis=1, keepdims=True))
    assert np.allclose(last.ys[1], np.moveaxis(first.ys[1], 1, 2))
    dx, dx_last = (done.backward(1, wanted=wanted)[0] for done in (first, last))
    assert np.allclose(dx_last, np.moveaxis(dx, 1, 2))


def test_the_loss_of_no_labels_is_zero_without_sign(run):
    """The log shows it as 0 and not as -0."""
    done = run('type: "SoftmaxWithLoss" loss_param { ignore_label: 1 }', np.ones((2, 3)), [1, 1])
    assert done.y == 0
    assert not np.signbit(done.y)


def test_h_from_a_file(run, rng, here):
    """A .binaryproto with K * K values in any shape is equivalent to a third bottom."""
    x, H = rng.normal(size=(2, 3)), rng.normal(size=(3, 3)).astype(np.float32)
    binaryproto.write_blob(H.reshape(1, 1, 3, 3), "H.binaryproto")
    options = 'type: "InfogainLoss" infogain_loss_param { source: "H.binaryproto" }'
    from_file = run(options, x, [2, 0])
    assert from_file.y == run('type: "InfogainLoss"', x, [2, 0], H).y


def test_a_reshape_to_the_same_shape_keeps_the_gradient(net_of, rng):
    net = net_of(
        'force_backward: true input: "a" input: "b" input_shape { dim: 4 dim: 3 } '
        'layer { name: "l" type: "SmoothL1Loss" bottom: "a" bottom: "b" top: "l" }'
    )
    net.forward(a=rng.normal(size=(4, 3)), b=rng.normal(size=(4, 3)))
    expected = net.backward()["a"].copy()
    net.reshape()
    assert np.array_equal(net.backward()["a"], expected)


@pytest.mark.parametrize(
    ("text", "default", "expected"),
    [
        ("", "VALID", "VALID"),
        ("", "BATCH_SIZE", "BATCH_SIZE"),
        ("normalize: true", "BATCH_SIZE", "VALID"),
        ("normalize: false", "VALID", "BATCH_SIZE"),
        ("normalization: NONE", "BATCH_SIZE", "NONE"),
        ("normalization: VALID normalize: false", "BATCH_SIZE", "VALID"),
    ],
)
def test_the_normalization_that_options_choose(text, default, expected):
    param = schema.read(prototxt.parse(text), LossParameter)
    assert labels.normalization(param, default) == expected


def test_a_divisor_is_at_least_1():
    assert [
        labels.divisor(name, np.zeros(0, bool), 0) for name in ("VALID", "FULL", "BATCH_SIZE")
    ] == [1, 1, 1]


def test_ignored_labels_do_not_count():
    """Labels are truncated before they are compared with ignore_label; NaN is never ignored, so
    that it is detected.
    """
    values = np.array([0, 0.9, -0.9, 1, -1, np.nan])
    assert labels.counted(values, None).all()
    assert labels.counted(values, 0)[:5].tolist() == [False, False, False, True, True]
    assert labels.counted(values, 255).all()
