"""FastHandAugment: transforms blocks of crops on all threads, without allocating arrays.

All random numbers are drawn before the blocks are distributed, so results do not depend on the
number of threads. OpenCV's own threads are disabled, because they would compete with this engine's
threads for the same processors.
"""

from __future__ import annotations

from functools import partial

import cv2
import numpy as np

from fast import parallel
from fast.fast_layer import FastLayer
from layers.hand.augment import HandAugment
from netlib.blob import Array, blocks

BLOCK = 16  # crops per job, 1 MB: they fit in the cache, and the overhead of a call is small


class FastHandAugment(FastLayer, HandAugment):
    """HandAugment computed on several threads."""

    def move_crops(self, x: Array, y: Array, source: Array, s: Array, d: Array) -> None:
        """Write the transformed crops to ``y``, one block per job."""
        s, d = (a.astype(self.dtype)[:, None, None] for a in (s, d))
        theirs = cv2.getNumThreads()
        cv2.setNumThreads(1)
        try:
            parts = blocks(len(x), BLOCK)
            parallel.run(
                [partial(self._move_block, x[b], y[b], source[b], s[b], d[b]) for b in parts]
            )
        finally:
            cv2.setNumThreads(theirs)

    def _move_block(self, x: Array, y: Array, source: Array, s: Array, d: Array) -> None:
        """Transform one block with the arithmetic of the plain layer; writes to ``y``."""
        S, how, old = x.shape[-1], cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP, x
        if self.warps:
            old = self.buffer("warped", x.shape)
            for n in range(len(x)):
                cv2.warpAffine(x[n], source[n], (S, S), old[n], how, cv2.BORDER_REPLICATE)
        background = old >= 1
        np.multiply(old, s, out=y)
        y += d
        np.clip(y, -1, 1, out=y)
        np.copyto(y, 1, where=background)
