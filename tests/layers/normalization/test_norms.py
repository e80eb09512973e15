"""LRN, compared with loops."""

import numpy as np
import pytest


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
