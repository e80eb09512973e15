"""handpose/synthetic/scenes/prior.py"""

from __future__ import annotations

from pathlib import Path

import pytest

from handpose.synthetic.scenes import prior as scene_prior
from handpose.synthetic.scenes.prior import SCENE_PRIOR
from netlib.errors import PrototxtError

TEXT = SCENE_PRIOR.read_text()


def test_the_training_has_the_things_that_stand_on_desks() -> None:
    names = [thing.name for thing in scene_prior.load().things.thing]
    assert len(set(names)) == len(names)
    assert {"keyboard", "mouse", "monitor", "lamp", "chair", "cup", "head"} <= set(names)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("legs: 0.5", "leg: 0.5", r":\d+:\d+: .*'leg'"),
        ("legs: 0.5", "", "missing required field 'legs'"),
        ("rests_mm { low: 10", "rests_mm { low: 30", r":\d+:\d+: error: low: expected low <= high"),
        ("low: 230", "low: 0", r":\d+:\d+: error: low: expected 0 < low <= high"),
        ("share: 4 size", "share: -4 size", r":\d+:\d+: error: share: expected a share above 0"),
        ("shape: BOX", "shape: CUBE", r":\d+:\d+: error: unknown value CUBE"),
    ],
)
def test_a_wrong_file_is_named_with_its_line(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    path = tmp_path / "scenes.prototxt"
    path.write_text(TEXT.replace(old, new, 1))
    with pytest.raises(PrototxtError, match=message):
        scene_prior.load(path)
