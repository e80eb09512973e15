"""Crop, Interp and Upsample: maps of another size."""

import logging

import numpy as np
import pytest

from tests.support.nets import inputs


@pytest.mark.parametrize("shape", [(2, 3), (2, 2, 3), (2, 1, 2, 3), (0, 3, 2, 2)])
def test_upsample_repeats_pixels_of_any_number_of_axes(by_hand, shape):
    x = np.arange(np.prod(shape)).reshape(shape)
    wide = x.repeat(3, axis=-1).repeat(3, axis=-2)
    by_hand("Upsample upsample_param { scale: 3 }", [x], [wide])


@pytest.mark.parametrize(
    ("options", "size", "warnings"),
    [
        ("", (3, 4), ["the first (1, 1, 3, 4) of (1, 1, 9, 8) remain"]),
        ("offset: 0", (3, 4), []),
        ("", (8, 7), []),  # the map has an odd size
    ],
)
def test_a_crop_without_an_offset_is_not_that_of_older_forks(run, caplog, options, size, warnings):
    x = np.arange(72.0).reshape(1, 1, 9, 8)
    bottoms = x, np.zeros((1, 1, *size))
    y = run(f'type: "Crop" crop_param {{ {options} }}', *bottoms).y
    assert np.array_equal(y, x[..., : size[0], : size[1]])
    assert len(caplog.messages) == len(warnings)
    for message, part in zip(caplog.messages, warnings):
        assert part in message and "near the offsets [3, 2]" in message


@pytest.mark.parametrize(
    ("options", "size"),
    [
        ("zoom_factor: 4", (25, 21)),
        ("shrink_factor: 3", (3, 2)),
        ("shrink_factor: 2 zoom_factor: 3", (10, 7)),
        ("height: 9 width: 2", (9, 2)),
        ("height: 9 width: 2 zoom_factor: 4", (25, 21)),  # one factor takes precedence over a size
        ("height: 9 width: 2 shrink_factor: 3", (3, 2)),
        ("height: 9 width: 2 shrink_factor: 2 zoom_factor: 3", (9, 2)),  # but not two
        ("zoom_factor: 2 pad_beg: -1 pad_end: -2", (7, 5)),
        ("zoom_factor: 1", (7, 6)),
    ],
)
def test_sizes_of_interp(run, rng, options, size):
    """The size follows from the options in the order of DeepLab's code; both corners are those of
    the cropped map.
    """
    x = rng.normal(size=(2, 3, 7, 6))
    y = run(f'type: "Interp" interp_param {{ {options} }}', x).y
    assert y.shape == (2, 3, *size)
    first, last = (1, -3) if "pad" in options else (0, -1)
    assert np.allclose(y[..., 0, 0], x[..., first, first])
    assert np.allclose(y[..., -1, -1], x[..., last, last])


@pytest.mark.parametrize(
    "options",
    [
        "",
        "use_blob_size: true",
        "use_blob_size: true zoom_factor: 2",
        "use_blob_size: true height: 9 width: 9",
    ],
)
def test_a_second_bottom_gives_the_size(run, rng, options):
    """If no option does, or with use_blob_size whatever they say; its gradient is 0."""
    x = rng.normal(size=(2, 3, 4, 4))
    done = run(f'type: "Interp" interp_param {{ {options} }}', x, np.zeros((1, 9, 6, 5)))
    assert np.array_equal(done.y, run('type: "Interp" interp_param { height: 6 width: 5 }', x).y)
    assert not done.backward(done.y)[1].any()


def test_any_size_of_interp_gives_what_plain_loops_give(run, rng):
    for H, W, Ho, Wo in rng.integers(1, 9, (20, 4)).tolist():
        x = rng.normal(size=(2, H, W))
        y = run(f'type: "Interp" interp_param {{ height: {Ho} width: {Wo} }}', x[None]).y[0]
        for h, w in np.ndindex(Ho, Wo):
            p = h * (H - 1) / max(Ho - 1, 1)
            q = w * (W - 1) / max(Wo - 1, 1)
            i, j = int(p + 1e-9), int(q + 1e-9)
            down, right = min(i + 1, H - 1), min(j + 1, W - 1)
            a, b = p - i, q - j
            above = (1 - b) * x[:, i, j] + b * x[:, i, right]
            below = (1 - b) * x[:, down, j] + b * x[:, down, right]
            assert np.allclose(y[:, h, w], (1 - a) * above + a * below)


def test_ignored_sizes_are_reported(run, caplog):
    with caplog.at_level(logging.WARNING, "netlib"):
        run(
            'type: "Interp" interp_param { zoom_factor: 2 height: 3 width: 3 }',
            np.zeros((1, 1, 2, 2)),
            np.zeros((1, 1, 4, 5)),
        )
    for what in ("ignores height", "ignores width", "size of bottom 'bottom1' is ignored"):
        assert what in caplog.text


@pytest.mark.parametrize(
    ("options", "size"),
    [
        ("", (4, 6)),
        ("scale: 3", (6, 9)),
        ("scale_h: 2 scale_w: 5", (4, 15)),
        ("scale: 2 pad_out_h: true", (3, 6)),
        ("scale: 2 pad_out_h: true pad_out_w: true", (3, 5)),
        ("upsample_h: 5 upsample_w: 7", (5, 7)),
        ("scale: 2 upsample_h: 5 upsample_w: 7", (5, 7)),
    ],
)
def test_sizes_of_upsample_with_a_mask(run, options, size):
    x = np.zeros((2, 1, 2, 3))
    assert run(f'type: "Upsample" upsample_param {{ {options} }}', x, x).y.shape == (2, 1, *size)


@pytest.mark.parametrize("kernel", ["kernel_size: 2 stride: 2", "kernel_size: 3 stride: 2 pad: 1"])
def test_after_a_pooling_with_a_mask(net_of, rng, kernel):
    """A pooling and an upsampling with its mask keep the maxima in place, and pass the
    gradient to them.
    """
    x = rng.permutation(2 * 3 * 6 * 6).reshape(2, 3, 6, 6) + 1.0
    pooling = f'type: "Pooling" pooling_param {{ {kernel} }}'
    upsample = 'type: "Upsample" upsample_param { upsample_h: 6 upsample_w: 6 }'
    net = net_of(
        f'force_backward: true {inputs(x=x.shape)} layer {{ name: "p" bottom: "x" top: "p" top: "mask" {pooling} }} '
        f'layer {{ name: "u" bottom: "p" bottom: "mask" top: "y" {upsample} }}',
        dtype=np.float64,
    )
    y = net.forward(x=x)["y"].copy()
    assert np.array_equal(y[y > 0], x[y > 0])
    assert set(np.unique(y)) == {0, *np.unique(net.blobs["p"].data)}
    dx = net.backward(y=np.ones_like(y))["x"]
    assert np.array_equal(dx > 0, y > 0)
