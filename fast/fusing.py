"""Fusing: a convolution computes the layers behind it, while its outputs are in the cache.

Batch normalization by its sums, a Scale with learned parameters and a ReLU or ReLU6 are a
multiplication, an addition and a maximum per channel: y = max(gain y + bias, 0). If they are in
place, the values between them are overwritten in any case, and their diffs are those of the layers
on their own. A layer may also write another blob, if the blob that it reads is read by no other
layer, and so is *unstored* (whole_steps.py). If a part of the net is run, each layer is computed
on its own. A layer with a backward pass is fused only in place, if it is a ReLU or ReLU6, which
store nothing, or a Scale directly behind a BatchNorm by the statistics of the batch
(per_channel.py).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace

import numpy as np

from fast.fast_layer import FastLayer
from layers.activation.relu import ReLU
from layers.activation.relu6 import ReLU6
from layers.activation.scale import Scale
from layers.normalization.batch_norm import BatchNorm
from netlib.blob import Array, Blob, blocks
from netlib.engine import Connection, writes_only_tops
from netlib.layer import Layer

BLOCK = 1 << 17  # values
MIN_ROW = 32  # values from which NumPy's loop over the rows of an array takes little time


@dataclass(frozen=True)
class After:
    """What is computed from the sums of a convolution: y = gain sum + bias, its maximum with 0 if
    ``rectify``, and the minimum with ``limit``.

    gain, bias  (O,) or None
    """

    gain: Array | None = None
    bias: Array | None = None
    rectify: bool = False
    limit: float | None = None

    def activate(self, values: Array, target: Array) -> None:
        """Write the maximum and the minimum of ``values`` to ``target``, which may be
        the same array.
        """
        if self.rectify:  # the maximum with a row takes a third of the time of that with a number
            row = values.shape[-1] if values.ndim else 0
            np.maximum(values, np.zeros(row, values.dtype) if row >= MIN_ROW else 0, out=target)
        if self.limit is not None:
            np.minimum(target, self.limit, out=target)

    def write(self, values: Array, target: Array, o: slice, axis: int = 0) -> None:
        """Write the outputs ``o`` for sums ``values`` to ``target``, which may be the same array.

        Both have the outputs on ``axis``. They are divided into blocks of outputs that
        stay in the cache.
        """
        count = target.shape[axis]
        given = self.gain is not None, self.bias is not None, self.rectify, self.limit is not None
        operations = sum(given)
        if operations == 0:
            if values is not target:
                target[...] = values
            return
        each = count if operations == 1 else max(1, BLOCK * count // max(target.size, 1))
        axes = target.ndim - axis
        gain, bias = self._wide(self.gain, o, axes), self._wide(self.bias, o, axes)
        for part in blocks(count, each):
            at = (slice(None),) * axis + (part,)
            own, out = values[at], target[at]
            if gain is not None:
                own = np.multiply(own, gain[part], out=out)
            if bias is not None:
                own = np.add(own, bias[part], out=out)
            self.activate(own, out)

    def fold(self, w: Array) -> tuple[Array, After]:
        """Weights (O, ...) with the gain in them, and the rest."""
        if self.gain is None:
            return w, self
        gain = self.gain.reshape(-1, *(1,) * (w.ndim - 1))
        return w * gain, replace(self, gain=None)

    def part(self, o: slice) -> After:
        """The same for some of the outputs."""
        gain, bias = (None if values is None else values[o] for values in (self.gain, self.bias))
        return After(gain, bias, self.rectify, self.limit)

    @staticmethod
    def _wide(values: Array | None, o: slice, axes: int) -> Array | None:
        """The values of the outputs ``o``, to be broadcast over the other axes."""
        return None if values is None else values[o].reshape(-1, *(1,) * (axes - 1))


def after_of(bias: Array | None, layers: Sequence[Layer]) -> After:
    """What a convolution with this bias and the layers behind it compute together."""
    gain: Array | None = None
    rectify, limit = False, None
    for layer in layers:
        if isinstance(layer, BatchNorm):
            mean, deviation = statistics(layer)
            gain = (1 if gain is None else gain) / deviation
            bias = ((0 if bias is None else bias) - mean) / deviation
        elif isinstance(layer, Scale):
            values = layer.gain.data.astype(np.float64)
            gain = values if gain is None else values * gain
            bias = None if bias is None else bias * values
            if layer.param.bias_term:
                bias = layer.bias.data if bias is None else bias + layer.bias.data
        else:
            rectify = True
            limit = 6.0 if isinstance(layer, ReLU6) else None
    dtype = layers[0].dtype if layers else None
    gain, bias = (None if values is None else np.asarray(values, dtype) for values in (gain, bias))
    return After(gain, bias, rectify, limit)


def statistics(layer: BatchNorm) -> tuple[Array, Array]:
    """Mean and standard deviation of each channel by the sums, (C,)."""
    weight = layer.weight.data[0]
    scale = 0 if weight == 0 else 1 / weight
    return scale * layer.mean.data, np.sqrt(scale * layer.variance.data + layer.param.eps)


def fuse(connections: Sequence[Connection], stored: Set[Blob]) -> None:
    """Let layers compute those behind them, where they can; blobs of ``stored`` stay stored."""
    release(connections)
    users = Counter(blob for at in connections for blob in set(at.blobs))
    last_writer = {blob.root: i for i, at in enumerate(connections) for blob in at.top}
    may_run_later = all(writes_only_tops(at.layer) for at in connections)
    for i, at in enumerate(connections):
        layer = at.layer
        if not isinstance(layer, FastLayer) or layer.is_fused or not layer.fuses_relu():
            continue
        if len(at.top) != 1:
            continue
        # an unstored blob is computed later, from what the first layer has read
        may_unstore = may_run_later and not at.needs_backward
        may_unstore &= all(last_writer.get(blob.root, -1) < i for blob in at.bottom)
        # other nets write what they share, at any time
        may_unstore &= all(param.owns_memory for param in layer.blobs)
        fixed = stored if may_unstore else users.keys()
        layer.after = _chain(at, connections[i + 1 :], users, fixed)
        for one in layer.after:
            one.is_fused = True


def _chain(
    at: Connection, followers: Sequence[Connection], users: Mapping[Blob, int], stored: Set[Blob]
) -> list[FastLayer]:
    """The layers behind a layer that it can compute without a blob of ``stored`` between them.

    users  the number of layers that use each blob
    """
    chain: list[FastLayer] = []
    blob, seen = at.top[0], 1  # the blob to be written, and its users among these layers
    for follower in followers:
        if not _continues(at, chain, follower, blob):
            break
        seen += 1
        if follower.top[0] is not blob:
            if follower.needs_backward or seen < users[blob] or blob in stored:
                break
            blob, seen = follower.top[0], 1
        assert isinstance(follower.layer, FastLayer)
        chain.append(follower.layer)
    return chain


def release(connections: Sequence[Connection]) -> None:
    """Let all layers be computed on their own."""
    for at in connections:
        if isinstance(at.layer, FastLayer):
            at.layer.after, at.layer.is_fused = (), False


def _continues(at: Connection, chain: Sequence[Layer], follower: Connection, blob: Blob) -> bool:
    """Whether a layer reads the blob that ``at`` and the chain behind it write, and can be computed
    with them.
    """
    first, layer = at.layer, follower.layer
    assert isinstance(first, FastLayer)
    if not isinstance(layer, FastLayer) or (chain and isinstance(chain[-1], (ReLU, ReLU6))):
        return False
    if len(follower.bottom) != 1 or len(follower.top) != 1 or follower.bottom[0] is not blob:
        return False
    if isinstance(layer, (ReLU, ReLU6)):
        return layer.is_monotone()
    if isinstance(layer, Scale) and first.fuses_trained_scale():
        # the dx of both is computed by the first
        if chain or (any(follower.propagate_down) and not any(at.propagate_down)):
            return False
    elif follower.needs_backward or not first.fuses_channels():
        return False
    if isinstance(layer, Scale):
        return layer.learned and layer.axis == 1 and layer.gain.shape == blob.shape[1:2]
    return isinstance(layer, BatchNorm) and layer.uses_sums
