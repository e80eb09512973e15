"""FastHandAugment: crops in blocks on all threads.

All random numbers are drawn before the work is shared out, so results do not depend on the number of threads. OpenCV's
own threads are kept out: the crops are shared out already, and more threads would fight for the same processors.
"""

from __future__ import annotations

from functools import partial

import cv2

from fast import parallel
from fast.twin import Twin
from layers.hand.augment import HandAugment
from netlib.blob import Array

BLOCK = 16  # crops per job, 1 MB: few enough to stay in the cache, many enough to hide the call


class FastHandAugment(Twin, HandAugment):
    """HandAugment on several threads."""

    def move_crops(self, x: Array, y: Array, source: Array, s: Array, d: Array) -> None:
        """Block by block."""
        move = super().move_crops
        jobs = [partial(move, x[b], y[b], source[b], s[b], d[b]) for b in parallel.blocks(len(x), BLOCK)]
        theirs = cv2.getNumThreads()
        cv2.setNumThreads(1)
        try:
            parallel.run(jobs)
        finally:
            cv2.setNumThreads(theirs)
