"""Recurrent: base class of LSTM and RNN with their options, bottoms, and the state carried
from step to step.

bottom[0]   x       (T, N, ...)  T time steps of N independent streams; the other axes are
                                 flattened to I features
bottom[1]   cont    (T, N)       1: the step continues the stream; 0: a new sequence starts
                                 from a zero state
bottom[2]   static  (N, ...)     optional: S features that are constant over time
bottom[-k:] states  (1, N, D)    with ``expose_hidden``: the k states before the first step
params[0]   w_x     (G, I)
params[1]   b       (G,)
params[2]   w_s     (G, S)       only with static
params[...] w_h     (G, D)
top[0]      h       (T, N, D)    D = num_output
top[-k:]    states  (1, N, D)    with ``expose_hidden``: the k states after the last step

z[t] = w_x x[t] + b + w_s static        (T, G, N): the input of a step without the recurrent part

During the computation, the values of a stream are a column: a step is w_h (G, D) times the
states (D, N), each gate is a block of rows, and a product reads the weights in the order in
which they are stored.

Without ``expose_hidden``, the first step of a batch continues from the states of the last forward,
initially zeros. They are part of the layer's state, so an exact resume is possible. As in Caffe, if
the number of streams decreases, the first ones continue; if it increases, all start from zero.

As in Caffe, no gradient flows from one batch to the previous one: the diffs of exposed states are
zeros, and those of exposed tops are ignored. cont has no gradient. The number of time steps is
fixed by the first batch.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from netlib.blob import Array, Blobs
from netlib.fillers import Filler
from netlib.layer import Layer
from netlib.proto.schema import UInt, numbered


@dataclass(frozen=True)
class RecurrentParameter:
    """The ``recurrent_param { ... }`` block."""

    num_output: UInt = numbered(1, 0)  # D
    weight_filler: Filler = numbered(2, Filler())
    bias_filler: Filler = numbered(3, Filler())
    # debug_info of the net that Caffe unrolls; accepted, ignored
    debug_info: bool = numbered(4, False)
    # read initial states from bottoms and write final states to tops
    expose_hidden: bool = numbered(5, False)


class Recurrent(Layer):
    """Base class of layers with a state over time.

    states  states after the last forward, (N, D) each
    """

    param: RecurrentParameter
    param_name = "recurrent_param"
    bottoms = (2, None)
    tops = (1, None)
    in_place = False
    state_count: ClassVar[int]  # k, number of states
    gates: ClassVar[int]  # G / D

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        D = self.param.num_output
        exposed = self.state_count if self.param.expose_hidden else 0
        if D == 0:
            raise self.fail("num_output must be at least 1", "num_output")
        if len(bottom) - exposed not in (2, 3) or len(top) != 1 + exposed:
            raise self.fail(
                f"has {len(bottom)} bottoms and {len(top)} tops, expected {2 + exposed} or {3 + exposed} "
                f"and {1 + exposed}",
                "expose_hidden",
            )
        self.first_exposed = len(bottom) - exposed  # number of the first bottom with states
        self.has_static = self.first_exposed == 3
        self.steps = bottom[0].shape[0] if bottom[0].shape else 0
        self.states: list[Array] = []
        self._check_axes(bottom)
        self.features = self._features(bottom)
        rows = self.gates * D
        self.w_x = self.new_param("w_x", (rows, self.features[0]), self.param.weight_filler)
        self.b = self.new_param("b", (rows,), self.param.bias_filler)
        if self.has_static:
            self.w_s = self.new_param("w_s", (rows, self.features[2]), self.param.weight_filler)
        self.w_h = self.new_param("w_h", (rows, D), self.param.weight_filler)

    def _features(self, bottom: Blobs) -> dict[int, int]:
        """The numbers of features of x, and of static if present, by the index of the bottom."""
        features = {0: math.prod(bottom[0].shape[2:])}
        if self.has_static:
            features[2] = math.prod(bottom[2].shape[1:])
        return features

    def _check_axes(self, bottom: Blobs) -> None:
        """Check that T and N of all bottoms agree. Raises LayerError."""
        x, names = bottom[0].shape, self.spec.bottom
        if len(x) < 3 or x[0] != self.steps or self.steps == 0:
            raise self.fail(
                f"bottom {names[0]!r} has shape {x}, expected ({self.steps or 'T'}, N, ...)"
            )
        T, N = x[:2]
        cont = bottom[1].shape
        if cont != (T, N):
            raise self.fail(
                f"bottom {names[1]!r} has shape {cont}, expected ({T}, {N}) as steps, streams "
                f"of {names[0]!r} {x}"
            )
        if self.has_static and (len(bottom[2].shape) < 2 or bottom[2].shape[0] != N):
            static = bottom[2].shape
            raise self.fail(
                f"bottom {names[2]!r} has shape {static}, expected ({N}, ...), the streams "
                f"of {names[0]!r} {x}"
            )
        for i in range(self.first_exposed, len(bottom)):
            if bottom[i].shape != (1, N, self.param.num_output):
                raise self.fail(
                    f"bottom {names[i]!r} has shape {bottom[i].shape}, "
                    f"expected (1, {N}, {self.param.num_output})"
                )

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        self._check_axes(bottom)
        for i, found in self._features(bottom).items():
            name, expected = self.spec.bottom[i], self.features[i]
            if found != expected:
                raise self.fail(
                    f"bottom {name!r} has {found} features {bottom[i].shape}, its weights expect {expected}"
                )
        T, N = bottom[1].shape
        for y, steps in zip(top, [T] + [1] * (len(top) - 1)):
            y.reshape(steps, N, self.param.num_output)

    def allow_force_backward(self, bottom_index: int) -> bool:
        return bottom_index != 1

    def state(self) -> dict[str, Any]:
        return {**super().state(), "states": [state.tolist() for state in self.states]}

    def restore(self, state: dict[str, Any]) -> None:
        super().restore(state)
        D = self.param.num_output
        self.states = [
            np.array(values, self.dtype).reshape(-1, D) for values in state.get("states", [])
        ]

    # ----------------------------------------------------------------------------- for LSTM and RNN

    def _write_z(self, bottom: Blobs, out: Array) -> None:
        """Compute z (T, G, N) for all steps, in ``out`` (T, ..., N)."""
        T, N = bottom[1].shape
        x, w_x = bottom[0].data.reshape(T, N, -1), self.w_x.data
        constant = self.b.data[:, None]
        if self.has_static:
            constant = constant + self.w_s.data @ bottom[2].data.reshape(N, -1).T
        # the steps of one stream are one product
        z = x[:, 0] @ w_x.T if N == 1 else w_x @ x.swapaxes(1, 2)
        np.add(z.reshape(out.shape), constant.reshape(*out.shape[1:-1], -1), out=out)

    def _cont(self, bottom: Blobs) -> list[Array | None]:
        """cont (N,) of each step; None if it is 1 for all streams, so that nothing need
        be multiplied.
        """
        cont = bottom[1].data
        return [None if goes_on else step for goes_on, step in zip((cont == 1).all(axis=1), cont)]

    def _backward_z(self, dz: Array, r: Array, propagate_down: list[bool], bottom: Blobs) -> None:
        """Backpropagate dz (T, G, N) to the parameters, w_h by the states r (T, D, N), and
        to all bottoms.
        """
        if propagate_down[1]:
            raise self.fail(
                f"bottom {self.spec.bottom[1]!r} (cont) has no gradient; set propagate_down: false"
            )
        (T, _, N), x = dz.shape, bottom[0]
        flat = in_rows(dz)
        self.w_x.diff[...] += flat.T @ x.data.reshape(T * N, -1)
        self.w_h.diff[...] += flat.T @ in_rows(r)
        self.b.diff[...] += dz.sum(axis=2).sum(axis=0, dtype=np.float64)
        if propagate_down[0]:
            np.matmul(flat, self.w_x.data, out=x.diff.reshape(T * N, -1))
        if self.has_static:
            static, total = bottom[2], dz.sum(axis=0)
            self.w_s.diff[...] += total @ static.data.reshape(N, -1)
            if propagate_down[2]:
                static.diff[...] = (total.T @ self.w_s.data).reshape(static.shape)
        for i in range(self.first_exposed, len(bottom)):
            if propagate_down[i]:
                bottom[i].diff[...] = 0

    def _first_states(self, bottom: Blobs) -> list[Array]:
        """States before the first step, (D, N) each."""
        if self.param.expose_hidden:
            return [blob.data[0].T for blob in bottom[-self.state_count :]]
        N = bottom[0].shape[1]
        if not self.states or len(self.states[0]) < N:
            return [np.zeros((self.param.num_output, N), self.dtype)] * self.state_count
        return [state[:N].T for state in self.states]

    def _keep_states(self, states: Sequence[Array], top: Blobs) -> None:
        """Store the states after the last step, (D, N) each."""
        if self.param.expose_hidden:
            for blob, state in zip(top[1:], states):
                blob.data[0] = state.T
        else:
            self.states = [state.T for state in states]


def in_rows(array: Array) -> Array:
    """Copy of (T, G, N) as (T N, G)."""
    T, G, N = array.shape
    return array.swapaxes(1, 2).reshape(T * N, G)
