"""The kinds of errors in a published frame, as reports name them."""

from __future__ import annotations

from netlib.errors import DataError

MISSING = "no such file"
DAMAGED = "truncated, damaged or no PNG"
WRONG_SIZE = "wrong size or type of image"
UNLABELLED = "a joint or the centre is not a number, or not before the camera"
OUTSIDE = "the cube lies outside the image"
EMPTY = "no depth around the hand"


class BadFrameError(DataError):
    """A frame that cannot be used; ``kind`` is one of the constants above."""

    def __init__(self, path: object, kind: str, detail: str = "") -> None:
        super().__init__(f"{path}: {kind}{detail and f' ({detail})'}")
        self.kind = kind
