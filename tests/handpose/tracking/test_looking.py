"""handpose/tracking/looking.py: by the packaged network and fit, in frames of a hand that is known"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handpose.depth_fit.search import ACCURATE
from handpose.facts.cameras import ICVL, Camera
from handpose.facts.sides import MIRROR, mirror_of
from handpose.prediction.packaged import load_predictor
from handpose.prediction.predictor import Predictor
from handpose.sequences.acts import Act
from handpose.sequences.recordings import SyntheticRecording
from handpose.sequences.scripts import Role, Script
from handpose.tracking import looking
from handpose.tracking.body_pose import Placed
from handpose.tracking.looking import Aim, Looker, Sight
from tests.handpose.tracking.conftest import Take

FAR_OFF = np.array([-900.0, 120, 700])  # px, px, mm: nothing of its cube is in the image
ASIDE = Camera("aside", 240.0, 241.0, 130.0, 110.0, 320, 240)


@pytest.fixture(scope="module")
def looker(predictor: Predictor) -> Looker:
    """At ICVL's camera."""
    return Looker(predictor, ICVL)


@pytest.fixture
def depth(shown: Take) -> np.ndarray:
    """A frame with a right hand."""
    return shown.frames[20].depth


@pytest.fixture
def center(shown: Take) -> np.ndarray:
    """Where it is, (3,) px, px, mm."""
    return shown.truth[20].hands[0].center_uvd


def joints(looker: Looker, sight: Sight | None) -> np.ndarray:
    """(K, 3) in mm, camera axes."""
    assert sight is not None
    mirror = mirror_of(sight.aim.side)
    return (looker.fitter.model.joints(sight.fit.x)[0] + sight.center_mm) * mirror


def error(looker: Looker, sight: Sight | None, shown: Take) -> float:
    """Of all joints, mm."""
    return float(np.linalg.norm(joints(looker, sight) - shown.truth[20].hands[0].xyz, axis=1).mean())


def test_a_hand_is_seen(looker: Looker, depth: np.ndarray, center: np.ndarray, shown: Take) -> None:
    """Where it is, and by the accurate plan, too; surely, and not strange."""
    for plan in (None, ACCURATE):
        (sight,) = looker.look(depth, [Aim(center, "right")], plan)
        assert sight is not None and error(looker, sight, shown) < 15
        assert sight.confidence > 0.7 and sight.badness < 15 and looker.rejection_score(sight) < 90
        np.testing.assert_allclose(sight.center_mm, ICVL.unproject(center))


def test_the_wrong_hand_is_doubted(looker: Looker, depth: np.ndarray, center: np.ndarray) -> None:
    """More than the right one."""
    right, left = looker.look(depth, [Aim(center, side) for side in ("right", "left")])
    assert right is not None and left is not None and right.doubt < left.doubt


def test_no_hand_is_strange(looker: Looker, depth: np.ndarray, center: np.ndarray) -> None:
    """More than a hand is: the forearm beside the image's edge, or a place beside the hand."""
    there, beside = looker.look(depth, [Aim(center, "right"), Aim(center + (0, 75, 0), "right")])
    assert there is not None and beside is not None
    assert looker.rejection_score(beside) > looker.rejection_score(there) + 15


def test_places_of_all_kinds_together(looker: Looker, depth: np.ndarray, center: np.ndarray) -> None:
    """In their order: each as when it is looked at alone, None where it is out of sight."""
    (before,) = looker.look(depth, [Aim(center, "right")])
    assert before is not None
    aims = [
        Aim(FAR_OFF, "left"),
        Aim(center, "right", before.body, 1.0),
        Aim(center + (5, 0, 0), "left"),
        Aim(center, "right"),
        Aim(center, "right", before.body, None, 4.0),
        Aim(center, "right", before.body, 0.95, 4.0),
        Aim(center + (2, 0, 0), "right", before.body),
        Aim(FAR_OFF, "right", before.body),
    ]
    together = looker.look(depth, aims)
    assert [sight is None for sight in together] == [True] + [False] * 6 + [True]
    for aim, sight in zip(aims[1:-1], together[1:-1]):
        (alone,) = looker.look(depth, [aim])
        assert sight is not None and sight.aim is aim
        np.testing.assert_allclose(joints(looker, sight), joints(looker, alone), atol=3)
    assert looker.look(depth, []) == [] and looker.look(depth, aims[:1]) == [None]


def test_a_known_size(looker: Looker, depth: np.ndarray, center: np.ndarray) -> None:
    """Of each its own."""
    sights = looker.look(depth, [Aim(center, "right", size=size) for size in (0.9, 1.1)])
    assert [float(sight.fit.size[0]) for sight in sights if sight] == pytest.approx([0.9, 1.1], abs=5e-3)


def test_from_the_pose_before(
    looker: Looker, depth: np.ndarray, center: np.ndarray, shown: Take, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also about another centre; without asking the network, if its last answer is given, which counts as before."""
    (first,) = looker.look(depth, [Aim(center, "right")])
    assert first is not None
    monkeypatch.setattr(looking, "fit_starts", None)  # whoever calls it fails
    where = ((0, 0, 0), (0, 0, 0), (8, -6, 20))
    aims = [Aim(center + by, "right", first.body, None, moved) for by, moved in zip(where, (1.0, 25.0, 25.0))]
    near, far, aside = looker.look(depth, aims)
    assert near is not None and far is not None and aside is not None
    assert not first.goes_on and near.goes_on and far.goes_on and aside.goes_on
    assert max(error(looker, sight, shown) for sight in (near, far, aside)) < 15
    assert near.fit.signs[0, -1] >= 1 and far.fit.signs[0, -1] >= 25 and far.doubt > near.doubt
    with pytest.raises(TypeError):
        looker.look(depth, [Aim(center, "right", first.body)])


def test_does_it_go_on(looker: Looker, depth: np.ndarray, center: np.ndarray) -> None:
    """Where both compete, what the network sees and what was expected: only if that is what won."""
    (first,) = looker.look(depth, [Aim(center, "right")])
    assert first is not None
    far = first.body._replace(others=-first.body.others, rotation=first.body.rotation @ np.diag([-1.0, 1, -1]))
    goes_on, anew = looker.look(depth, [Aim(center, "right", body) for body in (first.body, far)])
    assert goes_on is not None and goes_on.goes_on and anew is not None and not anew.goes_on


def test_a_left_hand_is_the_mirror_image() -> None:
    """In the mirrored image of the mirrored camera, which does not look from its middle.

    The accurate plan finds the same in both, though the window of a crop is rounded towards the left of the image.
    """
    recording = SyntheticRecording(Script(3, (Role("right", (Act("gestures", 3),)),)), ASIDE, rate=15, seed=2)
    depth, center = recording.frame(20).depth, recording.truth(20).hands[0].center_uvd
    in_mirror = dataclasses.replace(ASIDE, u0=ASIDE.width - 1 - ASIDE.u0)
    right, left = (Looker(load_predictor(own, fit="accurate"), own) for own in (ASIDE, in_mirror))
    place = np.array([ASIDE.width - 1 - center[0], *center[1:]])
    (one,) = right.look(depth, [Aim(center, "right")])
    (other,) = left.look(np.ascontiguousarray(depth[:, ::-1]), [Aim(place, "left")])
    assert one is not None and other is not None
    assert np.linalg.norm(joints(left, other) * MIRROR - joints(right, one), axis=1).mean() < 4
    assert left.rejection_score(other) == pytest.approx(right.rejection_score(one), rel=0.25)
    np.testing.assert_allclose(left.center_of(other.body, "left")[1:], right.center_of(one.body, "right")[1:], atol=5)


def test_where_the_next_crop_is(looker: Looker, depth: np.ndarray, center: np.ndarray) -> None:
    """About the middle of the palm, as the fit has it and as the locator has it."""
    (sight,) = looker.look(depth, [Aim(center + (10, 0, 0), "right")])
    assert sight is not None
    for found in (looker.center_of(sight.body, "right"), looker.hand_near(depth, sight)):
        assert np.linalg.norm(ICVL.unproject(found) - ICVL.unproject(center)) < 25


@given(place=st.tuples(st.floats(-200, 200), st.floats(-150, 150), st.floats(400, 900)))
def test_crops_move_with_the_body(looker: Looker, place: tuple[float, ...]) -> None:
    """As far as it; those of a left hand in the mirror image."""
    body = Placed(np.array(place), np.eye(3), np.zeros(len(looker.placer.others)))
    moved = body._replace(place=body.place + (10, 20, -30))
    first, second = (ICVL.unproject(looker.center_of(one, "right")) for one in (body, moved))
    np.testing.assert_allclose(second - first, (10, 20, -30), atol=1e-6)
    np.testing.assert_allclose(ICVL.unproject(looker.center_of(body, "left")), first * MIRROR, atol=1e-6)


@pytest.mark.parametrize("side", ["right", "left"])
def test_where_the_locator_sees_no_hand(
    looker: Looker, depth: np.ndarray, center: np.ndarray, side: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The network's joints tell where the palm is, and it moves with them."""
    (sight,) = looker.look(depth, [Aim(center, side)])
    assert sight is not None
    monkeypatch.setattr(looker.locator, "look", lambda crops: (np.zeros(len(crops)), np.ones((len(crops), 3))))
    beside = dataclasses.replace(sight.fit, network=sight.fit.network + (10, 20, 30))
    first, second = (ICVL.unproject(looker.hand_near(depth, sight._replace(fit=fit))) for fit in (sight.fit, beside))
    np.testing.assert_allclose(second - first, np.array((10, 20, 30)) * mirror_of(side), atol=1e-3)


def test_what_nobody_measured(looker: Looker, depth: np.ndarray, center: np.ndarray) -> None:
    """A network without a table of its errors: the misfit compares looks, and all that is seen is believed."""
    (sight,) = looker.look(depth, [Aim(center, "right")])
    assert sight is not None
    unknown = np.full(1, np.nan)
    sight = sight._replace(fit=dataclasses.replace(sight.fit, error_mm=unknown, confidence=unknown))
    assert sight.confidence == 1 and sight.badness == sight.fit.misfit[0]
    empty = sight._replace(fit=dataclasses.replace(sight.fit, doubt=np.full(1, np.inf)))
    assert empty.confidence == 0
