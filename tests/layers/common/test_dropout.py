"""Dropout."""

import numpy as np
import pytest


def test_values_are_zero_or_scaled(run):
    """Kept values are scaled by 1 / (1 - p), which preserves the mean; the gradient uses
    the same mask.
    """
    done = run('type: "Dropout" dropout_param { dropout_ratio: 0.2 }', np.ones((4, 500)))
    assert sorted(set(done.y.ravel().tolist())) == [0, pytest.approx(1.25)]
    assert done.y.mean() == pytest.approx(1, abs=0.05)
    [dx] = done.backward(np.full((4, 500), 2))
    assert np.array_equal(dx, 2 * done.y)


@pytest.mark.parametrize("ratio", [0.1, 0.3, 0.5, 0.9])
def test_the_part_that_is_dropped(run, ratio):
    done = run(f'type: "Dropout" dropout_param {{ dropout_ratio: {ratio} }}', np.ones(100_000))
    assert abs((done.y == 0).mean() - ratio) < 5 * np.sqrt(ratio * (1 - ratio) / 100_000)


def test_every_batch_has_another_mask(run):
    done = run('type: "Dropout"', np.ones(100))
    first = done.y.copy()
    done.layer.forward(done.bottom, done.top)
    assert not np.array_equal(done.y, first)


def test_fast_rcnns_dropout_scales_in_test(run):
    """With ``scale_train: false`` kept values are not scaled in TRAIN; TEST scales all
    values instead.
    """
    text = 'type: "Dropout" dropout_param { dropout_ratio: 0.25 scale_train: false }'
    train, test = (run(text, np.full(1000, 8.0), phase=phase) for phase in ("TRAIN", "TEST"))
    assert set(train.y) == {0, 8}
    assert set(test.y) == {6}
    assert set(test.backward(np.ones(1000))[0]) == {0.75}


def test_sampling_in_test(run):
    x = np.ones(4000)
    sampled = 'type: "Dropout" dropout_param { dropout_ratio: 0.25 sample_weights_test: true }'
    done = run(sampled, x, phase="TEST")
    assert set(np.unique(done.y)) == {0, 1 / 0.75}
    assert np.array_equal(done.y, run(sampled, x, phase="TRAIN").y)
    assert np.array_equal(done.backward(x)[0], done.y)
    assert np.array_equal(run(sampled.replace("true", "false"), x, phase="TEST").y, x)
