"""LRN: across channels, within a channel, at the edges."""

import numpy as np
import pytest


def text(**options):
    return f'type: "LRN" lrn_param {{ {" ".join(f"{k}: {v}" for k, v in options.items())} }}'


WITHIN = {"norm_region": "WITHIN_CHANNEL", "local_size": 3}


def test_across_channels_by_hand(run):
    """For channels 1, 2, 3 the scale is 1 + 3 / 3 * (sum of the squares of a channel and its two neighbours)."""
    done = run(text(local_size=3, alpha=3, beta=1), np.array([1.0, 2, 3]).reshape(1, 3, 1, 1))
    assert np.allclose(done.y.ravel(), [1 / (1 + 1 + 4), 2 / (1 + 1 + 4 + 9), 3 / (1 + 4 + 9)])


def test_within_a_channel_by_hand(run):
    """For a row 1, 2, 3 the sum is over 3 x 3 pixels, with zeros outside the image; k is ignored."""
    done = run(text(**WITHIN, alpha=9, beta=1, k=100), np.array([1.0, 2, 3]).reshape(1, 1, 1, 3))
    assert np.allclose(done.y.ravel(), [1 / (1 + 1 + 4), 2 / (1 + 1 + 4 + 9), 3 / (1 + 4 + 9)])


def test_the_constant_and_the_power(run):
    """The result is x / sqrt(k + alpha x²) for beta 0.5."""
    assert np.allclose(run(text(local_size=1, alpha=2, beta=0.5, k=7), np.full((1, 1, 1, 1), 3.0)).y, 3 / 5)


@pytest.mark.parametrize("size", [1, 3, 5, 15, 10**9 + 1])
@pytest.mark.parametrize("region", ["ACROSS_CHANNELS", "WITHIN_CHANNEL"])
def test_any_size_gives_what_plain_loops_give(run, rng, size, region):
    """Any size agrees with loops, also if the region is larger than the blob."""
    x = rng.normal(size=(2, 6, 4, 5))
    s, half = np.ones(x.shape), size // 2
    for n, c, h, w in np.ndindex(x.shape):
        if region == "ACROSS_CHANNELS":
            near = x[n, max(c - half, 0) : c + half + 1, h, w]
            s[n, c, h, w] += 0.7 / size * (near**2).sum()
        else:
            near = x[n, c, max(h - half, 0) : h + half + 1, max(w - half, 0) : w + half + 1]
            s[n, c, h, w] += 0.7 / size**2 * (near**2).sum()
    done = run(text(local_size=size, alpha=0.7, beta=0.6, norm_region=region), x)
    assert np.allclose(done.y, x / s**0.6)
