# Replace each NotImplementedError, then run: python tools/exercise.py sgd
"""Update rules and learning-rate policies: how gradients change the weights.

A rule processes one parameter at a time: its value w, gradient g (clipped, averaged, decayed), learning rate r (the
policy's rate times lr_mult), history h, and t, the number of this update counted from 1.

    SGD       h <- m h + r g                                           w <- w - h
    Nesterov  h' = m h + r g                                           w <- w - ((1 + m) h' - m h)
    AdaGrad   h <- h + g²                                              w <- w - r g / (sqrt(h) + d)
    RMSProp   h <- k h + (1 - k) g²                                    w <- w - r g / (sqrt(h) + d)
    AdaDelta  h <- m h + (1 - m) g²,  u = g sqrt((q + d) / (h + d)),
              q <- m q + (1 - m) u²                                    w <- w - r u
    Adam      h <- m h + (1 - m) g,  q <- n q + (1 - n) g²             w <- w - r c h / (sqrt(q) + d)
              c = sqrt(1 - n^t) / (1 - m^t)

m: momentum, n: momentum2, k: rms_decay, d: delta, q: the second history. As in Caffe, the history of SGD includes the
learning rate. Sources: Caffe's sgd_solvers.hpp; Kingma and Ba 2015 (Adam); Zeiler 2012 (AdaDelta).

A rule modifies w and the histories in place; it does not change g.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from netlib.blob import Array
from netlib.proto.messages import ParamSpec, SolverParameter

Rule = Callable[[SolverParameter, Array, Array, float, Sequence[Array], int], None]


def _sgd(p: SolverParameter, w: Array, g: Array, rate: float, history: Sequence[Array], t: int) -> None:
    # Change h, the only array of history, and then w: h <- m h + r g, w <- w - h. m is p.momentum, r is rate. Write
    # into both arrays (h[...] = ..., w -= ...), and leave g unchanged.
    raise NotImplementedError
