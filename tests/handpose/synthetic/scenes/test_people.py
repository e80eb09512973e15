"""handpose/synthetic/scenes/people.py"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.synthetic.scenes.cameras import Cameras
from handpose.synthetic.scenes.people import People
from tests.handpose.synthetic.scenes.conftest import drawn


def people_with(**hands: float) -> tuple[Cameras, People]:
    return drawn(np.random.default_rng(2), 64, **hands)[1:]


def test_the_first_hand_lies_in_the_frame_and_its_arm_ends_at_the_shoulder() -> None:
    cameras, people = people_with()
    u, v = cameras.pixels(people.palms[:, 0]).T
    assert ((u > 5) & (u < 155) & (v > 5) & (v < 123)).all()
    first = people.hands[0]
    upper = np.linalg.norm(first.elbow - people.person.shoulder(first.side), axis=1)
    elsewhere = ~cameras.on_head  # a head's shoulders are where they are
    np.testing.assert_allclose(upper[elsewhere], 290 * people.person.size[elsewhere, 0])


def test_hands_at_rest_turn_their_palms_down() -> None:
    cameras, people = people_with(rests=1.0)
    down = -(people.hands[0].palmar * cameras.up).sum(axis=1)
    assert np.median(down) > 0.7 and people.rests.all()


def test_hands_along_the_arm_hide_it_or_are_hidden_by_it() -> None:
    _, people = people_with(along=1.0, rests=0.0)
    first, palm = people.hands[0], people.palms[:, 0]
    forearm = first.elbow - first.wrist
    lengths = np.linalg.norm(forearm, axis=1) * np.linalg.norm(palm, axis=1)
    assert np.median(np.abs((forearm * palm).sum(axis=1)) / lengths) > 0.85


@pytest.mark.parametrize("none", [0.0, 1.0])
def test_the_share_without_hands_is_the_priors(none: float) -> None:
    _, people = people_with(none=none)
    assert (~people.there[:, 0]).mean() == none
