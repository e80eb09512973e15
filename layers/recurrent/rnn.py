"""RNN: a simple recurrent layer, whose state depends on the input and the previous state.

bottoms    x (T, N, ...), cont (T, N), static (N, ...) optional; with ``expose_hidden``, then
           initial h (1, N, D)
params     w_x (D, I), b (D,), w_s (D, S) only with static, w_h (D, D), w_o (D, D), b_o (D,)
top[0]     o  (T, N, D)       with ``expose_hidden``, followed by h after the last step, (1, N, D)

z is the contribution of x and static, computed for all steps at once (recurrent.py, the base class
shared with LSTM), and r = cont[t] h[t - 1]. Each step t computes

    h[t] = tanh(z[t] + w_h r)        o[t] = tanh(w_o h[t] + b_o)

and backwards, from the last step to the first, with dh the gradient of h[t] from the next step:

    da = do[t] (1 - o[t]²)        dw_o += daᵀ h[t]        db_o += da        dh += da w_o
    dz[t] = dh (1 - h[t]²)        dh[t - 1] = cont[t] dz[t] w_h

dw_h += dz[t]ᵀ r, dw_o and db_o of all steps are one product or sum each.

Kept for backward: ``h``, ``r`` and ``o`` of every step.
"""

from __future__ import annotations

import numpy as np

from layers.recurrent.recurrent import Recurrent, in_rows
from netlib.blob import Blobs


class RNN(Recurrent):
    """Simple recurrent layer."""

    state_count = 1  # h
    gates = 1

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        super().setup(bottom, top)
        D = self.param.num_output
        self.w_o = self.new_param("w_o", (D, D), self.param.weight_filler)
        self.b_o = self.new_param("b_o", (D,), self.param.bias_filler)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        T, N = bottom[1].shape
        z, self.r, self.h = np.empty((3, T, self.param.num_output, N), self.dtype)
        self._write_z(bottom, z)
        cont, w_h = self._cont(bottom), self.w_h.data
        [h] = self._first_states(bottom)
        for t in range(T):
            self.r[t] = h if cont[t] is None else cont[t] * h
            h = np.dot(w_h, self.r[t], out=self.h[t])
            h += z[t]
            np.tanh(h, out=h)
        self.o = np.tanh(self.w_o.data @ self.h + self.b_o.data[:, None])
        top[0].data[...] = self.o.swapaxes(1, 2)
        self._keep_states([h.copy()], top)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        da = top[0].diff.swapaxes(1, 2) * (1 - self.o**2)
        self.w_o.diff[...] += in_rows(da).T @ in_rows(self.h)
        self.b_o.diff[...] += in_rows(da).sum(axis=0, dtype=np.float64)
        dh_from_o = self.w_o.data.T @ da
        tanh_slope = 1 - self.h**2
        cont, w_h = self._cont(bottom), self.w_h.data
        dz = np.empty_like(da)
        dh = np.zeros_like(dh_from_o[0])  # from the next step
        for t in reversed(range(len(dz))):
            np.multiply(dh_from_o[t] + dh, tanh_slope[t], out=dz[t])
            np.dot(w_h.T, dz[t], out=dh)
            if cont[t] is not None:
                dh *= cont[t]
        self._backward_z(dz, self.r, propagate_down, bottom)
