"""RVL, a compression of 16-bit depth images (Wilson, "Fast Lossless Depth Image Compression", 2017).

An image is a series of runs: a number of zeros, a number of other values, and for each of these the difference d from
the one before, as 2 d, or -2 d - 1 if it is negative. A number is a series of digits of 3 bits, the lowest first; a
fourth bit is set if another digit follows. Digits fill words of 32 bits, little-endian, from the highest bits on.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

SHIFTS = np.arange(28, -1, -4, dtype=np.uint32)  # of the digits of a word
MAX_DIGITS = 7  # of a number: counts of pixels have at most 21 bits, differences 17


def decompress(content: bytes, height: int, width: int) -> NDArray[np.uint16]:
    """The image (height, width) in the bytes of an RVL image. Raises ValueError for damaged ones."""
    pixels = height * width
    numbers = _numbers(content)
    is_value = np.zeros(pixels, bool)
    codes = []
    read = written = 0
    while written < pixels:
        if read + 2 > len(numbers):
            raise ValueError(f"RVL: ends after {written} of {pixels} pixels")
        zeros, values = int(numbers[read]), int(numbers[read + 1])
        first, written = written + zeros, written + zeros + values
        read += 2 + values
        if written > pixels or read > len(numbers) or not zeros + values:
            raise ValueError(f"RVL: a run of {zeros} zeros and {values} values ends beyond the {pixels} pixels")
        is_value[first:written] = True
        codes.append(numbers[read - values : read])
    code = np.concatenate(codes) if codes else np.zeros(0, np.int64)
    image = np.zeros(pixels, np.uint16)
    image[is_value] = np.cumsum((code >> 1) ^ -(code & 1)).astype(np.uint16)
    return image.reshape(height, width)


def _numbers(content: bytes) -> NDArray[np.int64]:
    """All complete numbers of the bytes; the digits after the last one are padding."""
    words = np.frombuffer(content[: len(content) // 4 * 4], "<u4")
    digits = ((words[:, None] >> SHIFTS) & 15).reshape(-1).astype(np.int64)
    ends = np.flatnonzero(digits < 8)
    if not len(ends):
        return np.zeros(0, np.int64)
    starts = np.concatenate([[0], ends[:-1] + 1])
    place = np.arange(ends[-1] + 1) - np.repeat(starts, ends + 1 - starts)
    if place.max() >= MAX_DIGITS:
        raise ValueError(f"RVL: a number of {place.max() + 1} digits; expected at most {MAX_DIGITS}")
    return np.asarray(np.add.reduceat((digits[: len(place)] & 7) << (3 * place), starts))
