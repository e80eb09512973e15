"""handpose/body/capsules.py"""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from handpose.body.capsules import CLEAR_MM, Capsules, in_front, joined


def along_z(*ends: tuple[float, float]) -> Capsules:
    """Capsules of radius 10 mm on the optical axis, between two depths each."""
    near, far = (np.array([[(0.0, 0.0, end[i]) for end in ends]]) for i in (0, 1))
    radius = np.full((1, len(ends)), 10.0)
    return Capsules(near, far, radius, radius)


def test_only_the_parts_in_front_of_the_camera_stay() -> None:
    """A capsule is cut where its sphere touches the plane; one behind it becomes a speck."""
    kept = in_front(along_z((300, 500), (-100, 400), (-100, -50)))
    assert_allclose(kept.a[0, :, 2][:2], [300, CLEAR_MM + 10])
    assert_allclose(kept.b[0, :, 2][:2], [500, 400])
    assert kept.a[0, 2, 2] > 1e5 and kept.radius_a[0, 2] < 0.01


def test_facets_are_those_of_the_capsules_that_are_joined_and_chosen() -> None:
    facet = np.array([[0, 2, 3]])
    one = along_z((300, 400), (500, 600))._replace(facets=facet)
    both = joined([along_z((100, 200)), one])
    assert both.facets.tolist() == [[2, 4, 5]]
    assert both.chosen(np.array([False, True, True])).facets.tolist() == facet.tolist()
    assert not len(both.chosen(np.array([True, True, False])).facets)
