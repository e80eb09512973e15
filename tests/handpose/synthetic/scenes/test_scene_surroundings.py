"""handpose/synthetic/scenes/surroundings.py"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.testing import assert_allclose

from handpose.synthetic.scenes import prior as scene_prior
from handpose.synthetic.scenes.draws import Draw, Range, Sizes
from handpose.synthetic.scenes.people import People
from handpose.synthetic.scenes.prior import PartParameter, ThingParameter
from handpose.synthetic.scenes.solids import CYLINDER, Solids
from handpose.synthetic.scenes.surroundings import Table, draw_table, draw_things
from netlib.proto import schema
from tests.handpose.synthetic.scenes.conftest import drawn

COUNT = 32


def people_and_table(**hands: float) -> tuple[People, Table]:
    rng = np.random.default_rng(4)
    prior, _, people = drawn(rng, COUNT, **hands)
    near = people.palms[:, 0]
    return people, draw_table(Draw(rng, COUNT), prior.table, people, near, prior.hands.rests_mm)


def things_of(thing: ThingParameter, table: Table, people: People, **things: Any) -> Solids:
    prior = schema.changed(scene_prior.load().things, thing=(thing,), share=1.0, each=1.0, **things)
    draw = Draw(np.random.default_rng(6), COUNT)
    solids, of = draw_things(draw, prior, people.person, people.palms[:, 0], table)
    assert (of == 0).all()
    return solids


def test_a_table_is_below_a_hand_that_rests_on_it() -> None:
    people, table = people_and_table(rests=1.0)
    assert table.there.all()
    normal = table.axes[..., 1]
    height = ((people.palms[:, 0] - table.top) * normal).sum(axis=1)
    assert (height > 9).all() and (height < 25).all()
    assert_allclose(normal, -people.hands[0].palmar)


def test_things_stand_on_the_table() -> None:
    """The lower end of each cylinder is at the height of the table's upper face."""
    people, table = people_and_table()
    can = ThingParameter(
        "can", 1.0, (PartParameter("CYLINDER", Sizes(20.0, 30.0), Sizes(40.0, 60.0)),)
    )
    solids = things_of(can, table, people, most=3)
    assert solids.shown.all()
    assert solids.kind.shape == (COUNT, 3)
    assert (solids.kind == CYLINDER).all()
    on = table.there
    foot = solids.center - solids.axes[..., 1] * solids.half[..., 1:2]
    up = table.axes[:, None, :, 1]
    height = ((foot - table.top[:, None]) * up).sum(axis=-1)
    assert_allclose(height[on], 0, atol=1e-9)


def test_the_parts_of_a_thing_keep_their_places() -> None:
    people, table = people_and_table()
    side = Range(50.0, 50.0)
    large, small = Sizes(10.0, 10.0), Sizes(5.0, 5.0)
    lower = PartParameter("BOX", large, large)
    beside = PartParameter("BOX", small, small, at_x=side, lean=Range(90.0, 90.0))
    two = ThingParameter("two", 1.0, (lower, beside), stands="ROOM", size=Sizes(2.0, 2.0))
    solids = things_of(two, table, people, most=1)
    apart = solids.center[:, 1] - solids.center[:, 0]
    along = np.einsum("nij,ni->nj", solids.axes[:, 0], apart)
    assert_allclose(along - (100, -10, 0), 0, atol=1e-9)
    assert_allclose(solids.axes[:, 1, :, 0], solids.axes[:, 0, :, 1], atol=1e-12)
    assert_allclose(solids.axes[:, 0, :, 1], people.person.up)


def test_the_shares_choose_what_stands_there() -> None:
    people, table = people_and_table()
    prior = scene_prior.load().things
    prior = schema.changed(prior, share=1.0, each=1.0)
    solids, of = draw_things(
        Draw(np.random.default_rng(8), COUNT), prior, people.person, people.palms[:, 0], table
    )
    first = np.concatenate([[True], of[1:] != of[:-1]])
    assert list(of[first]) == sorted(set(of))
    assert len(set(of)) == len(prior.thing)
    shown = [solids.shown[:, of == k].any() for k in range(len(prior.thing))]
    assert np.mean(shown) > 0.9
