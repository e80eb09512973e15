"""BatchNorm: the statistics of a batch, and the sums over many batches."""

import numpy as np
import pytest

TEXT = 'type: "BatchNorm"'
KEPT = TEXT + " batch_norm_param { moving_average_fraction: 0.5 }"
STORED = TEXT + " batch_norm_param { use_global_stats: true eps: 0 }"


@pytest.mark.parametrize(
    ("options", "phase", "x", "y"),
    [
        (
            "eps: 0",
            "TRAIN",
            [[1, 3], [3, 7]],
            [[-1, -1], [1, 1]],
        ),  # means 2 and 5, variances 1 and 4
        ("eps: 3", "TRAIN", [[1], [3]], [[-0.5], [0.5]]),  # (1 - 2) / sqrt(1 + 3)
        # before the first batch mean and variance are 0, not NaN
        ("eps: 0.25", "TEST", [[1], [7]], [[2], [14]]),
        ("use_global_stats: true", "TRAIN", np.zeros((0, 2)), np.zeros((0, 2))),
    ],
)
def test_by_hand(by_hand, options, phase, x, y):
    by_hand(f"BatchNorm batch_norm_param {{ {options} }}", [x], [y], phase=phase)


def test_every_batch_is_added_to_the_sums(run):
    """Earlier batches are scaled by the moving average fraction; the variance is multiplied by
    M / (M - 1), here 2.
    """
    done = run(KEPT, [[1, 3], [3, 7]])
    mean, variance, weight = (blob.data for blob in done.layer.blobs)
    assert (mean.tolist(), variance.tolist(), weight.tolist()) == ([2, 5], [2, 8], [1])
    done.layer.forward(done.bottom, done.top)
    assert (mean.tolist(), variance.tolist(), weight.tolist()) == ([3, 7.5], [3, 12], [1.5])


@pytest.mark.parametrize(
    ("text", "phase"), [(STORED, "TRAIN"), (TEXT + " batch_norm_param { eps: 0 }", "TEST")]
)
def test_the_sums_normalise(run, text, phase):
    """With stored statistics of mean 6 / 2 and variance 8 / 2, the gradient is scaled and the sums
    do not change.
    """
    done = run(text, [[1], [7]], phase=phase, params=[[6], [8], [2]])
    assert done.y.tolist() == [[-1], [2]]
    assert done.backward([[4], [6]])[0].tolist() == [[2], [3]]
    assert [blob.data.tolist() for blob in done.layer.blobs] == [[6], [8], [2]]


def test_one_value_per_channel(run):
    """With one value per channel the variance is 0, and the factor M / (M - 1) is 1."""
    done = run(TEXT, [[5, 6]])
    assert done.y.tolist() == [[0, 0]]
    assert [blob.data.tolist() for blob in done.layer.blobs] == [[5, 6], [0, 0], [1]]


def net_text(options):
    """Return a net with a BatchNorm layer."""
    return f"""
        layer {{ name: "x" type: "Input" top: "x" input_param {{ shape {{ dim: 4 dim: 3 }} }} }}
        layer {{ name: "b" bottom: "x" top: "y" {TEXT} {options} }}
    """


@pytest.mark.parametrize(
    "options", ["", "param { lr_mult: 0 }", "param { lr_mult: 0 decay_mult: 0 }" * 3], ids=str
)
def test_a_solver_leaves_the_sums_alone(net_of, options):
    assert [param.spec.lr_mult for param in net_of(net_text(options)).learnable] == [0, 0, 0]


@pytest.mark.parametrize("shape", [(1024, 2, 16, 16), (8192, 3)])
@pytest.mark.parametrize("mean", [0, 1000])
def test_float32_keeps_its_digits(run, rng, mean, shape):
    """float32 results agree with float64 for many items, even if the mean is far larger than
    the deviation.
    """
    x, dy = rng.normal(mean, 1, shape).astype(np.float32), rng.normal(size=shape).astype(np.float32)
    single, double = (run(TEXT, x, dtype=dtype) for dtype in (np.float32, np.float64))
    assert np.allclose(single.y, double.y, rtol=0, atol=2e-6)
    assert np.allclose(single.backward(dy)[0], double.backward(dy)[0], rtol=0, atol=4e-6)
