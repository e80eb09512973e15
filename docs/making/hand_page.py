"""docs/hand.html: the packaged hand as a page for the browser, with the gestures that have a name."""

from __future__ import annotations

from collections.abc import Iterator

from docs.making.made import Made
from handpose.drawing.page.assembly import page
from handpose.drawing.page.content import content
from handpose.synthetic.gestures import poses
from handpose.synthetic.pose_prior import BodySampler
from netlib.files.paths import ROOT

PLACE = ROOT / "docs" / "hand.html"


def made() -> Iterator[Made]:
    """The page."""
    yield Made(PLACE, _page)


def _page() -> bytes:
    sampler = BodySampler()
    return page("The hand", content(sampler.skeleton, poses=poses(sampler))).encode()
