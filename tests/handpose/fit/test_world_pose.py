"""handpose/fit/body.py: WorldPose"""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from handpose.fit.body import CapsuleModel, crop_variables, world_pose

CENTERS = st.tuples(*(st.floats(-500, 500),) * 3)


@given(seed=st.integers(0, 10**6), first=CENTERS, second=CENTERS)
def test_there_and_back(model: CapsuleModel, seed: int, first: tuple[float, ...], second: tuple[float, ...]) -> None:
    """Any pose of the hand is converted between any two centres: its joints in space stay the same."""
    x = np.random.default_rng(seed).uniform(-1, 1, model.variables)
    x[model.root] *= 4
    again = crop_variables(model, world_pose(model, x, np.array(first)), np.array(second))
    np.testing.assert_allclose(model.joints(again[None])[0] + second, model.joints(x[None])[0] + first, atol=1e-3)
    others = model.root_motion.others
    np.testing.assert_array_equal(again[others], x[others])
