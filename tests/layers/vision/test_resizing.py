"""Crop, Interp and Upsample: maps of another size."""

import logging

import numpy as np
import pytest

from tests.support.nets import inputs


def map_of(rows):
    return np.array([[rows]], float)


MAP = np.arange(20.0).reshape(1, 1, 4, 5)
BLOCK = np.arange(12.0).reshape(2, 3, 2)
MASK = map_of([[5, 2], [8, 15]])  # in a map of 4 x 4
SIXTEEN = np.arange(16.0).reshape(1, 1, 4, 4)

# type and options, bottoms, top, dy, dx
BY_HAND = [
    (
        "Crop crop_param { offset: 1 offset: 2 }",
        [MAP, np.zeros((7, 7, 2, 3))],
        map_of([[7, 8, 9], [12, 13, 14]]),
        map_of([[1, 2, 3], [4, 5, 6]]),
        [map_of([[0] * 5, [0, 0, 1, 2, 3], [0, 0, 4, 5, 6], [0] * 5]), np.zeros((7, 7, 2, 3))],
    ),
    # of all axes
    (
        "Crop crop_param { offset: 1 }",
        [MAP, np.zeros((1, 1, 2, 2))],
        map_of([[6, 7], [11, 12]]),
        0,
        [],
    ),
    ("Crop", [MAP, np.zeros((1, 1, 1, 2))], map_of([[0, 1]]), 0, []),
    (
        "Crop crop_param { axis: 1 offset: 1 offset: 0 }",
        [BLOCK, np.zeros((9, 2, 1))],
        BLOCK[:, 1:, :1],
        0,
        [],
    ),
    ("Crop crop_param { axis: -1 offset: 1 }", [BLOCK, np.zeros((9, 9, 1))], BLOCK[..., 1:], 0, []),
    # three columns become five and two rows three, each new value in the middle of its neighbours
    (
        "Interp interp_param { height: 3 width: 5 }",
        [map_of([[0, 2, 4], [10, 12, 18]])],
        map_of([[0, 1, 2, 3, 4], [5, 6, 7, 9, 11], [10, 11, 12, 15, 18]]),
        map_of([[0, 8, 0, 0, 0], [0, 0, 0, 0, 0], [0, 0, 0, 0, 4]]),
        [map_of([[4, 4, 0], [0, 0, 4]])],
    ),
    (
        "Interp interp_param { height: 3 width: 4 }",
        [map_of([[1, 5, 2, 7]])],
        map_of([[1, 5, 2, 7]] * 3),
        0,
        [],
    ),
    ("Interp interp_param { height: 1 width: 1 }", [map_of([[1, 5, 2, 7]])], map_of([[1]]), 0, []),
    (
        "Interp interp_param { height: 3 width: 2 }",
        [np.zeros((0, 2, 1, 4))],
        np.zeros((0, 2, 3, 2)),
        0,
        [],
    ),
    (
        "Upsample upsample_param { scale: 2 }",
        [map_of([[1, 2], [3, 4]])],
        map_of([[1, 1, 2, 2], [1, 1, 2, 2], [3, 3, 4, 4], [3, 3, 4, 4]]),
        SIXTEEN,
        [map_of([[10, 18], [42, 50]])],
    ),
    ("Upsample", [MAP], MAP, 0, []),
    *(
        (
            "Upsample upsample_param { scale: 3 }",
            [x],
            x.repeat(3, axis=-1).repeat(3, axis=-2),
            0,
            [],
        )
        for shape in ((2, 3), (2, 2, 3), (2, 1, 2, 3), (0, 3, 2, 2))
        for x in [np.arange(np.prod(shape)).reshape(shape)]
    ),
    # each value goes to the pixel that the mask names; other pixels are 0
    (
        "Upsample",
        [map_of([[1, 2], [3, 4]]), MASK],
        map_of([[0, 0, 2, 0], [0, 1, 0, 0], [3, 0, 0, 0], [0, 0, 0, 4]]),
        10 * SIXTEEN,
        [map_of([[50, 20], [80, 150]]), np.zeros((1, 1, 2, 2))],
    ),
    # of values with the same place, as overlapping windows have, the last one is kept, and it
    # gets the gradient
    (
        "Upsample",
        [map_of([[1, 2], [3, 4]]), map_of([[5, 5], [0, 5]])],
        map_of([[3, 0, 0, 0], [0, 4, 0, 0], [0] * 4, [0] * 4]),
        np.ones((1, 1, 4, 4)),
        [map_of([[0, 0], [1, 1]]), None],
    ),
    ("Upsample", [np.zeros((0, 3, 2, 2))] * 2, np.zeros((0, 3, 4, 4)), 0, []),
]


@pytest.mark.parametrize(("layer", "bottoms", "top", "dy", "dx"), BY_HAND)
def test_by_hand(by_hand, layer, bottoms, top, dy, dx):
    by_hand(layer, bottoms, [top], [dy], dx)


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
            MAP,
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
