"""handpose/synthetic/scenes/people.py"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.synthetic.scenes import prior as scene_prior
from handpose.synthetic.scenes.cameras import Cameras, draw_cameras
from handpose.synthetic.scenes.people import People, draw_people
from handpose.synthetic.whole_scenes import SceneGenerator
from netlib.proto import schema

COUNT = 64


def drawn(**hands: float) -> tuple[Cameras, People]:
    """People whose ``hands { ... }`` have other numbers."""
    prior = scene_prior.load()
    prior = schema.changed(prior, hands=schema.changed(prior.hands, **hands))
    rng = np.random.default_rng(2)
    cameras = draw_cameras(rng, prior.view, COUNT)
    return cameras, draw_people(rng, prior, SceneGenerator().sampler, cameras)


def test_the_first_hand_lies_in_the_frame_and_its_arm_ends_at_the_shoulder() -> None:
    cameras, people = drawn()
    u, v = cameras.pixels(people.palms[:, 0]).T
    assert ((u > 5) & (u < 155) & (v > 5) & (v < 123)).all()
    first = people.hands[0]
    upper = np.linalg.norm(first.elbow - people.person.shoulder(first.side), axis=1)
    elsewhere = ~cameras.on_head  # a head's shoulders are where they are
    np.testing.assert_allclose(upper[elsewhere], 290 * people.person.size[elsewhere, 0])


def test_hands_at_rest_turn_their_palms_down() -> None:
    cameras, people = drawn(rests=1.0)
    down = -(people.hands[0].palmar * cameras.up).sum(axis=1)
    assert np.median(down) > 0.7 and people.rests.all()


def test_hands_along_the_arm_hide_it_or_are_hidden_by_it() -> None:
    _, people = drawn(along=1.0, rests=0.0)
    first = people.hands[0]
    forearm = (first.elbow - first.wrist) / np.linalg.norm(first.elbow - first.wrist, axis=1)[
        :, None
    ]
    sight = people.palms[:, 0] / np.linalg.norm(people.palms[:, 0], axis=1)[:, None]
    assert np.median(np.abs((forearm * sight).sum(axis=1))) > 0.85


@pytest.mark.parametrize("none", [0.0, 1.0])
def test_the_share_without_hands_is_the_priors(none: float) -> None:
    _, people = drawn(none=none)
    assert (~people.there[:, 0]).mean() == none
