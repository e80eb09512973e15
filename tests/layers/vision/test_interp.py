"""Interp."""

import logging

import numpy as np
import pytest


def text(**options):
    return f'type: "Interp" interp_param {{ {" ".join(f"{k}: {v}" for k, v in options.items())} }}'


def test_by_hand(run):
    """Three columns become five and two rows three, each new value in the middle of its neighbours."""
    done = run(text(height=3, width=5), [[[[0.0, 2, 4], [10, 12, 18]]]])
    assert done.y.tolist() == [[[[0, 1, 2, 3, 4], [5, 6, 7, 9, 11], [10, 11, 12, 15, 18]]]]
    [dx] = done.backward([[[[0, 8, 0, 0, 0], [0, 0, 0, 0, 0], [0, 0, 0, 0, 4]]]])
    assert dx.tolist() == [[[[4, 4, 0], [0, 0, 4]]]]


@pytest.mark.parametrize(("options", "size"), [
    ({"zoom_factor": 4}, (25, 21)),
    ({"shrink_factor": 3}, (3, 2)),
    ({"shrink_factor": 2, "zoom_factor": 3}, (10, 7)),
    ({"height": 9, "width": 2}, (9, 2)),
    ({"height": 9, "width": 2, "zoom_factor": 4}, (25, 21)),  # one factor takes precedence over a size
    ({"height": 9, "width": 2, "shrink_factor": 3}, (3, 2)),
    ({"height": 9, "width": 2, "shrink_factor": 2, "zoom_factor": 3}, (9, 2)),  # but not two
    ({"zoom_factor": 2, "pad_beg": -1, "pad_end": -2}, (7, 5)),
    ({"zoom_factor": 1}, (7, 6)),
], ids=str)
def test_sizes(run, rng, options, size):
    """The size follows from the options in the order of DeepLab's code; both corners are those of the cropped map."""
    x = rng.normal(size=(2, 3, 7, 6))
    y = run(text(**options), x).y
    assert y.shape == (2, 3, *size)
    first, last = -options.get("pad_beg", 0), -1 + options.get("pad_end", 0)
    assert np.allclose(y[..., 0, 0], x[..., first, first])
    assert np.allclose(y[..., -1, -1], x[..., last, last])


def test_the_size_of_a_second_bottom(run, rng):
    """A second bottom gives the size if no option does; its gradient is 0."""
    x = rng.normal(size=(2, 3, 4, 4))
    done = run('type: "Interp"', x, np.zeros((1, 9, 6, 5)))
    assert np.array_equal(done.y, run(text(height=6, width=5), x).y)
    assert not done.backward(done.y)[1].any()


@pytest.mark.parametrize("options", [{}, {"zoom_factor": 2}, {"height": 9, "width": 9}], ids=str)
def test_use_blob_size(run, rng, options):
    """The size of the second bottom, whatever the other options say."""
    x = rng.normal(size=(2, 3, 4, 4))
    done = run(text(use_blob_size="true", **options), x, np.zeros((1, 9, 6, 5)))
    assert np.array_equal(done.y, run(text(height=6, width=5), x).y)


def test_one_row_and_one_column(run, rng):
    """A single row is repeated, and a single output is the first value."""
    x = rng.normal(size=(1, 2, 1, 4))
    assert np.array_equal(run(text(height=3, width=4), x).y, x.repeat(3, axis=2))
    assert np.array_equal(run(text(height=1, width=1), x).y, x[..., :1])
    assert run(text(height=3, width=2), np.zeros((0, 2, 1, 4))).y.shape == (0, 2, 3, 2)


def test_any_size_gives_what_plain_loops_give(run, rng):
    """Values agree with a loop over all pixels."""
    for H, W, Ho, Wo in rng.integers(1, 9, (20, 4)).tolist():
        x = rng.normal(size=(2, H, W))
        y = run(text(height=Ho, width=Wo), x[None]).y[0]
        for h, w in np.ndindex(Ho, Wo):
            p, q = h * (H - 1) / max(Ho - 1, 1), w * (W - 1) / max(Wo - 1, 1)
            i, j = int(p + 1e-9), int(q + 1e-9)
            down, right = min(i + 1, H - 1), min(j + 1, W - 1)
            a, b = p - i, q - j
            above = (1 - b) * x[:, i, j] + b * x[:, i, right]
            below = (1 - b) * x[:, down, j] + b * x[:, down, right]
            assert np.allclose(y[:, h, w], (1 - a) * above + a * below)


def test_ignored_sizes_are_reported(run, caplog):
    with caplog.at_level(logging.WARNING, "netlib"):
        run(text(zoom_factor=2, height=3, width=3), np.zeros((1, 1, 2, 2)), np.zeros((1, 1, 9, 9)))
    messages = " ".join(record.getMessage() for record in caplog.records)
    assert all(what in messages for what in ("ignores height", "ignores width", "size of bottom 'bottom1' is ignored"))
