"""handpose/prediction/locator.py"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import netlib
from handpose.data.places import CUBE_MM, SIZE
from handpose.facts.cameras import NYU
from handpose.prediction.finding import find_hand
from handpose.prediction.locator import APART_MM, FARTHER_MM, HANDS, Locator
from handpose.prediction.packaged import load_locator
from handpose.synthetic.scenes import draw_scenes
from netlib.errors import DataError, NetlibError

NET = """
layer { name: "in" type: "Input" top: "depth" input_param { shape { dim: 1 dim: 1 dim: 64 dim: 64 } } }
layer { name: "score" type: "InnerProduct" bottom: "depth" top: "score" inner_product_param { num_output: 2 } }
layer { name: "chance" type: "Softmax" bottom: "score" top: "chance" }
layer { name: "where" type: "InnerProduct" bottom: "depth" top: "where" inner_product_param { num_output: 3 } }
"""
NetOf = Callable[..., netlib.Net]


@pytest.fixture
def drawn_to_the_right(net_of: NetOf) -> Locator:
    """Everything is a hand, the more the nearer it is, and always 20 mm to the right."""
    net = net_of(NET, netlib.TEST)
    net.params["score"][0].data[1, SIZE * SIZE // 2 + SIZE // 2] = -1
    net.params["where"][1].data[0] = 20 / (CUBE_MM / 2)
    return Locator(net)


def two_plates() -> np.ndarray:
    """One at 700 mm, one at 900."""
    depth = np.zeros((480, 640))
    depth[220:260, 150:190], depth[220:260, 450:480] = 700, 900
    return depth


def test_where_the_net_says(drawn_to_the_right: Locator) -> None:
    """From places on the surface, four times 20 mm to the right; apart from each other, the likeliest first."""
    found = drawn_to_the_right.hands(two_plates(), NYU)
    *likely, _ = found.odds  # the nearest object is the last
    assert 1 < len(found.center) <= HANDS + 1 and (np.diff(likely) <= 0).all()
    apart = np.linalg.norm(found.center[:, None] - found.center, axis=2) + 1e9 * np.eye(len(found.center))
    assert apart.min() > APART_MM
    left = NYU.unproject(np.array([150, 240, 700]))[0]
    assert found.center[:-1, 0].min() > left + 4 * 20
    np.testing.assert_allclose(found.center[-1], NYU.unproject(find_hand(two_plates(), NYU)))


def test_the_nearest_thing_is_told_as_well(net_of: NetOf) -> None:
    """However unlikely: a fist that the net has never seen. What is far away is less likely than the same nearby."""
    net = net_of(NET, netlib.TEST)
    net.params["where"][1].data[0] = 0.25  # everything is drawn away from where it is
    found = Locator(net).hands(two_plates(), NYU)
    nearest = NYU.unproject(find_hand(two_plates(), NYU))
    np.testing.assert_allclose(found.center[-1], nearest)
    far = np.ptp(found.center[:, 2])
    assert far > 150 and np.ptp(found.odds) == pytest.approx(far / FARTHER_MM, rel=0.2)


def test_many_crops(drawn_to_the_right: Locator) -> None:
    """In pieces, with the same answers as one by one."""
    crops = np.random.default_rng(0).uniform(-1, 1, (70, SIZE, SIZE)).astype(np.float32)
    chance, where = drawn_to_the_right.look(crops)
    assert chance.shape == (70,) and where.shape == (70, 3)
    np.testing.assert_allclose(where, np.tile([20.0, 0, 0], (70, 1)), rtol=1e-5)
    np.testing.assert_allclose(chance[69], drawn_to_the_right.look(crops[69:])[0][0], rtol=1e-5)


def test_the_packaged_locator_finds_hands() -> None:
    """With forearms before them, bodies behind them, things beside them; those are often the nearest things."""
    scenes, locator = draw_scenes(np.random.default_rng(5), 21), load_locator()
    best = [locator.hands(depth, NYU).center[0] for depth in scenes.depth]
    assert (np.linalg.norm(best - scenes.center, axis=1) < 50).mean() > 0.9
    nearest = [NYU.unproject(find_hand(depth, NYU)) for depth in scenes.depth]
    assert (np.linalg.norm(nearest - scenes.center, axis=1) < 50).mean() < 0.7


def test_nothing_to_be_found(drawn_to_the_right: Locator) -> None:
    """Nothing seen, or everything far away: one line."""
    with pytest.raises(DataError, match="no depth anywhere in the image"):
        drawn_to_the_right.hands(np.zeros((480, 640)), NYU)
    with pytest.raises(DataError, match="nothing as large as a hand is seen nearer than 1600 mm"):
        drawn_to_the_right.hands(np.full((480, 640), 3000.0), NYU)


def test_out_of_sight(drawn_to_the_right: Locator) -> None:
    """A locator gone astray is one line."""
    drawn_to_the_right.net.params["where"][1].data[0] = 50
    with pytest.raises(DataError, match="what may be a hand is out of sight"):
        drawn_to_the_right.hands(two_plates(), NYU)


def test_other_nets(net_of: NetOf) -> None:
    """Are refused when the locator is made; weights that are not finite when they answer."""
    with pytest.raises(NetlibError, match=r"blob 'where' of shape None an item, expected \(3,\) of a locator"):
        Locator(net_of(NET.replace('top: "where"', 'top: "there"'), netlib.TEST))
    with pytest.raises(NetlibError, match=r"blob 'depth' of shape \(1, 32, 64\) an item, expected \(1, 64, 64\)"):
        Locator(net_of(NET.replace("dim: 64", "dim: 32", 1), netlib.TEST))
    net = net_of(NET, netlib.TEST)
    net.params["where"][1].data[1] = np.nan
    with pytest.raises(NetlibError, match="answers that are not finite; check its weights"):
        Locator(net).look(np.zeros((1, SIZE, SIZE)))
