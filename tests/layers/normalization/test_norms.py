"""LRN, MVN and Normalize: by hand, and LRN compared with loops."""

import numpy as np
import pytest

# channels of means 2 and 20, and deviations 1 and 10
PAIRS = np.array([[1.0, 3], [10, 30]]).reshape(1, 2, 1, 2)
LINE = np.array([1.0, 2, 3])
SCALED = [1 / (1 + 5), 2 / (1 + 14), 3 / (1 + 13)]  # 1 + squares of a value and its neighbours


def mvn(x, eps):
    """Return the values and, for dy = (1, 0, 0), the gradient, which ignores eps, as in Caffe."""
    deviation = np.std(x) + eps
    y = (x - np.mean(x)) / deviation
    return y, (np.array([2, -1, -1]) - y * y[0]) / 3 / deviation


WITH_EPS, GRADIENT = mvn([1, 2, 6], 3)


@pytest.mark.parametrize(
    ("layer", "x", "y", "dy", "dx"),
    [
        (
            "LRN lrn_param { local_size: 3 alpha: 3 beta: 1 }",
            LINE.reshape(1, 3, 1, 1),
            SCALED,
            None,
            None,
        ),
        # the sum is over 3 x 3 pixels, with zeros outside the image; k is ignored
        (
            "LRN lrn_param { norm_region: WITHIN_CHANNEL local_size: 3 alpha: 9 beta: 1 k: 100 }",
            LINE.reshape(1, 1, 1, 3),
            SCALED,
            None,
            None,
        ),
        (
            "LRN lrn_param { local_size: 1 alpha: 2 beta: 0.5 k: 7 }",
            [[[[3.0]]]],
            [3 / 5],
            None,
            None,
        ),
        ("MVN mvn_param { eps: 0 }", PAIRS, [-1, 1, -1, 1], None, None),
        ("MVN mvn_param { normalize_variance: false }", PAIRS, [-1, 1, -10, 10], None, None),
        (
            "MVN mvn_param { across_channels: true normalize_variance: false }",
            PAIRS,
            [-10, -8, -1, 19],
            None,
            None,
        ),
        (
            "MVN mvn_param { across_channels: true eps: 0 }",
            PAIRS,
            (PAIRS - 11).ravel() / PAIRS.std(),
            None,
            None,
        ),
        ("MVN mvn_param { eps: 3 }", PAIRS[:, :1], [-0.25, 0.25], None, None),  # (1 - 2) / (1 + 3)
        ("MVN", np.full((1, 1, 1, 3), 7.0), [0, 0, 0], None, None),
        ("MVN mvn_param { eps: 3 }", [[[[1.0, 2, 6]]]], WITH_EPS, [1, 0, 0], GRADIENT),
        # four axes
        (
            "MVN mvn_param { across_channels: true }",
            np.zeros((2, 3)),
            np.zeros((2, 3, 1, 1)),
            None,
            None,
        ),
        # the item has length 11, and of dy = (1, 1) only the part across x = (3, 4) remains:
        # (1, 1) - (3, 4) 7 / 25
        (
            "Normalize",
            np.array([1.0, 2, 4, 10]).reshape(1, 2, 1, 2),
            np.array([1, 2, 4, 10]) / 11,
            None,
            None,
        ),
        ("Normalize norm_param { eps: 0 }", [[3.0, 4]], [0.6, 0.8], [1, 1], [0.032, -0.024]),
        (
            "Normalize norm_param { across_spatial: false eps: 16 }",
            [[3.0, 0]],
            [0.6, 0],
            None,
            None,
        ),
        ("Normalize", np.zeros((2, 3)), np.zeros(6), None, None),
    ],
)
def test_by_hand(run, layer, x, y, dy, dx):
    kind, _, options = layer.partition(" ")
    done = run(f'type: "{kind}" {options}', x)
    np.testing.assert_allclose(done.y.ravel(), np.ravel(y), rtol=1e-8, atol=1e-12)
    assert done.y.shape == (np.shape(y) if np.ndim(y) > 1 else np.shape(x))
    if dy is not None:
        np.testing.assert_allclose(
            done.backward(np.reshape(dy, done.y.shape))[0].ravel(), dx, rtol=1e-8
        )


def test_a_scale_of_each_channel(by_hand):
    """The channels (3, 4) have length 5, (0, 2) length 2; the scales are 10 and 100."""
    x, y = (np.reshape(values, (1, 2, 1, 2)) for values in ([3.0, 0, 4, 2], [6, 0, 80, 100]))
    layer = "Normalize norm_param { across_spatial: false channel_shared: false eps: 0 }"
    by_hand(layer, [x], [y], params=[[10, 100]])


def test_the_gradient_of_a_shared_scale(run):
    done = run('type: "Normalize"', [[3.0, 4]])
    done.backward([[1, 1]])
    assert done.layer.scale.shape == ()
    assert np.isclose(done.layer.scale.diff, 7 / 5)


@pytest.mark.parametrize("size", [1, 3, 5, 15, 10**9 + 1])
@pytest.mark.parametrize("region", ["ACROSS_CHANNELS", "WITHIN_CHANNEL"])
def test_any_size_of_lrn_gives_what_plain_loops_give(run, rng, size, region):
    """Also if the region is larger than the blob."""
    x = rng.normal(size=(2, 6, 4, 5))
    s, half = np.ones(x.shape), size // 2

    def near(i):
        return slice(max(i - half, 0), i + half + 1)

    for n, c, h, w in np.ndindex(x.shape):
        if region == "ACROSS_CHANNELS":
            s[n, c, h, w] += 0.7 / size * (x[n, near(c), h, w] ** 2).sum()
        else:
            s[n, c, h, w] += 0.7 / size**2 * (x[n, c, near(h), near(w)] ** 2).sum()
    options = f"local_size: {size} alpha: 0.7 beta: 0.6 norm_region: {region}"
    done = run(f'type: "LRN" lrn_param {{ {options} }}', x)
    assert np.allclose(done.y, x / s**0.6)
