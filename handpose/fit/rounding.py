"""Round values to a grid, so that a result does not depend on the last bits of a matrix product.

BLAS sums in an order that depends on the processor, so the products of two processors differ in
their last bits. A search that branches (which capsule is nearest, is the cost lower, which start is
best) turns such a difference into another local minimum, millimetres away. Two things prevent this:

- products whose sums decide are computed in float64,
- what comes out of a network or of a step is rounded to a grid that is far coarser than the
  differences and far finer than the accuracy. Two processors then continue with the same numbers,
  unless a value lies at the edge between two grid points: with differences of 1e-7 and a grid of
  2**-8, that happens to one value in 40,000.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from netlib.blob import Array

# Powers of two, so that rounding is exact.
NETWORK_STEP = 2.0**-8  # for a network's inputs of a skeleton: 0.2 degrees, 0.6 mm for a hand
PLACE_STEP_MM = 2.0**-2  # for predicted places
FIT_STEP = 2.0**-16  # for a fit's variables: 0.001 degrees, 0.002 mm for a hand


def rounded(values: ArrayLike, step: float) -> Array:
    """The nearest multiples of ``step``, float64."""
    return np.rint(np.asarray(values, np.float64) / step) * step
