"""handpose/body/render.py"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from handpose.body.capsules import NO_FACETS, Capsules, joined
from handpose.body.render import normalise_depth, render_crop
from handpose.frames.cameras import NYU
from handpose.frames.crops import crop, window
from handpose.sequences.recordings import render_image
from netlib.errors import DataError

CENTER = np.array([[320.0, 240.0, 800.0]])


def capsules(*each: tuple[tuple[float, ...], tuple[float, ...], float, float]) -> Capsules:
    """One frame of capsules (a, b, radius at a, radius at b)."""
    a, b, ra, rb = zip(*each, strict=True)
    return Capsules(*(np.array([values], dtype=float) for values in (a, b, ra, rb)))


def random_capsules(rng: np.random.Generator, N: int, M: int) -> Capsules:
    """Capsules of a hand's sizes around (0, 0, 800), in all directions."""
    a = rng.normal(size=(N, M, 3)) * (50, 50, 40) + (0, 0, 800)
    b = a + rng.normal(size=(N, M, 3)) * 25
    return Capsules(a, b, rng.uniform(5, 18, (N, M)), rng.uniform(5, 18, (N, M)))


def spheres(hand: Capsules, center: NDArray[np.float64], steps: int = 300) -> NDArray[np.float64]:
    """The depth crop of the first frame by the simple method: many spheres along each capsule."""
    columns, rows = (index[0] for index in window(center, 300.0))
    x, y = (columns - NYU.u0) / NYU.fx, (NYU.v0 - rows) / NYU.fy
    d = np.stack(np.broadcast_arrays(x[None, :], y[:, None], 1.0), axis=-1)
    dd = (d * d).sum(-1)
    depth = np.full(dd.shape, center[0, 2] + 150)
    for a, b, ra, rb in zip(*(values[0] for values in hand[:4]), strict=True):
        for s in np.linspace(0, 1, steps):
            c, r = a + s * (b - a), ra + s * (rb - ra)
            cd = d @ c
            inside = cd * cd - dd * (c @ c - r * r)
            hit = inside >= 0
            near = (cd[hit] - np.sqrt(inside[hit])) / dd[hit]
            depth[hit] = np.minimum(depth[hit], near)
    return depth


def assert_same_depth(made: NDArray[np.float32], expected: NDArray[np.float64]) -> None:
    """Assert equality to 0.1 mm, except for single pixels on the outline, where
    float32 may miss.
    """
    assert (np.abs(made - expected) > 0.1).mean() < 0.001


@pytest.mark.parametrize(
    "capsule",
    [
        ((0, 0, 800), (0, 0, 800), 30, 30),  # a sphere
        ((-40, 0, 800), (40, 30, 820), 10, 10),  # a cylinder with round ends
        ((-40, 0, 800), (40, 30, 820), 25, 5),  # a cone
        ((0, 0, 700), (2, 1, 850), 10, 10),  # pointing at the camera
        ((0, 0, 700), (2, 1, 850), 5, 40),  # the same, the thick end behind: its side shows
        ((0, 0, 700), (2, 1, 850), 40, 5),  # the same, the thick end hides the thin one
        ((0, 0, 850), (2, 1, 700), 5, 40),
        ((30, 20, 750), (32, 20, 750), 30, 10),  # one sphere inside the other
        ((30, 20, 750), (32, 20, 750), 10, 30),
    ],
)
def test_one_capsule(capsule: tuple[tuple[float, ...], tuple[float, ...], float, float]) -> None:
    """A capsule is the union of the spheres along it, from any direction."""
    hand = capsules(capsule)
    made = render_crop(hand, CENTER, 300.0)[0]
    assert (made < 950).any()
    assert_same_depth(made, spheres(hand, CENTER))


def test_nearest_capsule_is_seen() -> None:
    rng = np.random.default_rng(1)
    hand = random_capsules(rng, 1, 12)
    made = render_crop(hand, CENTER, 300.0)[0]
    assert_same_depth(made, spheres(hand, CENTER))
    other = Capsules(*(values[:, ::-1] for values in hand[:4]))
    np.testing.assert_array_equal(made, render_crop(other, CENTER, 300.0)[0])


def test_equals_cropping_the_whole_image() -> None:
    """Rendering only the crop's rays equals rendering 640 x 480 pixels and cropping,
    borders included.
    """
    rng = np.random.default_rng(2)
    for uvd in ((320.4, 239.7, 812.3), (40.0, 30.0, 700.0), (600.0, 460.0, 950.0)):
        hand = random_capsules(rng, 1, 20)
        shift = NYU.unproject(uvd) - (0, 0, 800)
        hand = hand._replace(a=hand.a + shift, b=hand.b + shift)
        direct = render_crop(hand, [uvd], 300.0)
        direct = normalise_depth(direct, [uvd[2]], 300.0)[0]
        whole = render_image(hand, NYU, background=5000.0)[0]
        cropped = crop(whole, uvd, 300.0)
        assert (cropped < 1).any()
        assert (np.abs(direct - cropped) > 1e-3).sum() <= 3  # pixels on the outline, within float32


def test_frames_do_not_mix() -> None:
    rng = np.random.default_rng(3)
    hands = random_capsules(rng, 5, 20)
    centers = np.array([[320.0, 240.0, 800.0]]) + rng.normal(size=(5, 3)) * (10, 10, 20)
    cubes = rng.uniform(200, 300, 5)
    together = render_crop(hands, centers, cubes)
    for n in range(5):
        one = hands.frames(slice(n, n + 1))
        alone = render_crop(one, centers[n : n + 1], cubes[n])
        assert (np.abs(together[n] - alone[0]) > 0.01).sum() <= 2


def test_behind_the_camera() -> None:
    for z in (5.0, -800.0, np.nan):
        with pytest.raises(DataError, match="at or behind the camera"):
            render_crop(capsules(((0, 0, z), (0, 0, 800), 10, 10)), CENTER, 300.0)


def wedge(corners: NDArray[np.float64], radii: tuple[float, ...]) -> Capsules:
    """The hull of three spheres: its edges, and the facet between them."""
    ends = np.asarray(corners, float)[None]
    r = np.array([radii], float)
    following = [np.roll(values, -1, axis=1) for values in (ends, r)]
    return Capsules(ends, following[0], r, following[1], np.array([[0, 2, 4]]))


CORNERS = np.array([(-60.0, -30, 800), (50, -40, 830), (10, 60, 780)])


@pytest.mark.parametrize("turn", [(0, 0, 0), (0, 1.5, 0), (2.5, 0.5, 1), (1.57, 0, 0)], ids=str)
@pytest.mark.parametrize("radii", [(15, 15, 15), (25, 10, 16), (5, 20, 40)], ids=str)
def test_a_wedge_is_the_hull_of_its_spheres(
    turn: tuple[float, ...], radii: tuple[float, ...]
) -> None:
    """A wedge is the union of all spheres interpolated between its three, seen from
    any direction.
    """
    corners = Rotation.from_rotvec(turn).apply(CORNERS - CORNERS.mean(axis=0)) + (0, 0, 800)
    one = wedge(corners, radii)
    made = render_crop(one, CENTER, 300.0)[0]
    parts = np.array([(i, j, 60 - i - j) for i in range(61) for j in range(61 - i)])
    places, sizes = (parts[None] @ np.array(values, float) / 60 for values in (corners, radii))
    many = Capsules(places, places, sizes, sizes)
    expected = np.fmin(render_crop(many, CENTER, 300.0)[0], spheres(one, CENTER))
    assert (np.abs(made - expected) > 0.3).mean() < 0.002  # the spheres are 2 mm apart
    assert (made < 950).sum() > 1000


def test_facets_follow_their_capsules() -> None:
    one, other = wedge(CORNERS, (15, 15, 15)), capsules(((0, 0, 700), (9, 9, 720), 5, 5))
    both = joined([other, one, other])
    assert both.facets.tolist() == [[2, 4, 6]]
    assert both.chosen(np.array([False, True, True, True, False])).facets.tolist() == [[0, 2, 4]]
    assert both.chosen(np.array([True, True, True, False, False])).facets.tolist() == []
    apart = np.fmin(render_crop(one, CENTER, 300.0), render_crop(other, CENTER, 300.0))
    assert np.array_equal(render_crop(both, CENTER, 300.0), apart)


def test_three_spheres_in_a_row_have_no_facet() -> None:
    """Spheres in a row, or within the hull of the others, are rendered as capsules only."""
    for corners, radii in ((CORNERS[[0, 0, 1]], (9, 9, 9)), (CORNERS, (9, 9, 400.0))):
        one = wedge(corners, radii)
        plain = render_crop(one._replace(facets=NO_FACETS), CENTER, 300.0)
        assert np.array_equal(render_crop(one, CENTER, 300.0), plain)
