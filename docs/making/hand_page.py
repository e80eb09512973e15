"""docs/hand.html: the packaged hand as a page for the browser, with its named poses, and other bodies."""

from __future__ import annotations

from collections.abc import Iterator

from docs.making.made import Made
from handpose.output.hand_page.assembly import page
from handpose.output.hand_page.content import body, content
from handpose.sequences.gestures import poses
from handpose.synthetic import prior_file
from handpose.synthetic.pose_prior import BodySampler
from layers.hand import skeleton as skeletons
from layers.hand.skeleton import Skeleton
from layers.hand.skeleton_file import SkeletonParameter
from netlib.files.paths import ROOT
from netlib.proto import prototxt, schema

PERSON_UNIT_MM = 1200.0
# The arm of chapters 8 and 9: two bones in a plane, in numbers for pencil and paper.
ARM = """name: "arm"
dof { name: "shoulder" }
dof { name: "elbow" lower: 0 upper: 2.6 }
joint { name: "elbow" rotate { axis: Z dof: "shoulder" } bone { axis: X length: 5 } }
joint { name: "wrist" parent: "elbow" rotate { axis: Z dof: "elbow" } bone { axis: X length: 2 } }
"""


def made() -> Iterator[Made]:
    """The page."""
    yield Made(ROOT / "docs" / "hand.html", _page)


def _page() -> bytes:
    hand, nyu = BodySampler(prior_file.load(prior_file.PEOPLE_PRIOR)), BodySampler()
    arm = Skeleton(schema.read(prototxt.parse(ARM, "arm.prototxt"), SkeletonParameter))
    person = skeletons.load(ROOT / "prototxt" / "body" / "person.prototxt")
    bodies = [
        body("hand", hand.skeleton, poses(hand)), body("nyu", nyu.skeleton, poses(nyu)), body("arm", arm),
        body("person", person, unit_mm=PERSON_UNIT_MM),
    ]
    return page("The hand", content(bodies)).encode()
