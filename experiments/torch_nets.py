"""A net in PyTorch, with the same weights, made from its layers."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from export.onnx.hand import steps_of
from layers.hand.skeleton import Skeleton
from netlib.layer import TRAIN, Layer
from netlib.net import Net

Operation = Callable[..., Tensor]


class TorchNet(nn.Module):
    """The layers of a net in PyTorch. BatchNorm and a Scale behind it are one operation.

    pairs  PyTorch's parameters by a layer's name and the number of its parameter
    steps  operation, bottoms and tops of each layer, in the order of forward

    The method ``_convolution`` and the like return the operation of a layer of that type.
    """

    def __init__(self, net: Net) -> None:
        super().__init__()
        self.outputs = net.outputs
        self.pairs: dict[tuple[str, int], nn.Parameter] = {}
        self.steps: list[tuple[Operation, tuple[str, ...], tuple[str, ...]]] = []
        layers = [layer for layer in net.layers if layer.spec.bottom]
        for before, layer in zip([None, *layers], layers):
            bottoms = tuple(layer.spec.bottom)
            if layer.type == "Scale" and before is not None and before.type == "BatchNorm":
                _, bottoms, _ = self.steps.pop()  # the BatchNorm's
                operation = self._norm(before, layer)
            else:
                operation = getattr(self, f"_{layer.type.lower()}")(layer)
            self.steps.append((operation, bottoms, tuple(layer.spec.top)))

    def forward(self, **inputs: Tensor) -> Tensor:
        """The net's only output, or the sum of its losses."""
        values = dict(inputs)
        for operation, bottoms, tops in self.steps:
            result = operation(*(values[name] for name in bottoms))
            values.update(dict.fromkeys(tops, result))
        outputs = [values[name] for name in self.outputs]
        return outputs[0] if len(outputs) == 1 else torch.stack(outputs).sum()

    def _param(self, layer: Layer, number: int) -> Tensor | None:
        """PyTorch's copy of a parameter, None if the layer has no such parameter."""
        if number >= len(layer.blobs):
            return None
        param = nn.Parameter(torch.from_numpy(layer.blobs[number].data.copy()))
        self.register_parameter(f"{layer.name}_{number}", param)
        self.pairs[layer.name, number] = param
        return param

    def _convolution(self, layer: Layer, transposed: bool = False) -> Operation:
        w, b = self._param(layer, 0), self._param(layer, 1)
        options = {"stride": layer.stride, "padding": layer.pad, "groups": layer.param.group}  # type: ignore[attr-defined]
        if transposed:
            return lambda x: F.conv_transpose2d(x, w, b, **options)
        options["dilation"] = layer.dilation  # type: ignore[attr-defined]
        function = F.conv3d if len(layer.kernel) == 3 else F.conv2d  # type: ignore[attr-defined]
        return lambda x: function(x, w, b, **options)

    def _deconvolution(self, layer: Layer) -> Operation:
        return self._convolution(layer, transposed=True)

    def _innerproduct(self, layer: Layer) -> Operation:
        w, b = self._param(layer, 0), self._param(layer, 1)
        return lambda x: F.linear(x.flatten(1), w, b)

    def _norm(self, norm: Layer, scale: Layer) -> Operation:
        gain, bias = self._param(scale, 0), self._param(scale, 1)
        mean, variance = (torch.from_numpy(norm.blobs[i].data.copy()) for i in range(2))
        trains, eps = norm.phase == TRAIN, norm.param.eps
        return lambda x: F.batch_norm(x, mean, variance, gain, bias, trains, 0.001, eps)

    def _batchnorm(self, layer: Layer) -> Operation:
        return self._identity  # replaced with the Scale behind it

    @staticmethod
    def _identity(x: Tensor) -> Tensor:
        return x

    def _pooling(self, layer: Layer) -> Operation:
        kernel, stride, pad = layer.kernel, layer.stride, layer.pad  # type: ignore[attr-defined]
        if layer.param.global_pooling:
            return lambda x: x.mean((2, 3), keepdim=True)
        pool = F.max_pool2d if layer.is_max else F.avg_pool2d  # type: ignore[attr-defined]
        return lambda x: pool(x, kernel, stride, pad, ceil_mode=True)

    def _relu(self, layer: Layer) -> Operation:
        return torch.relu

    def _sigmoid(self, layer: Layer) -> Operation:
        return torch.sigmoid

    def _swish(self, layer: Layer) -> Operation:
        return F.silu

    def _lstm(self, layer: Layer) -> Operation:
        """Of sequences that do not end. Caffe's gates are i, f, o, g, PyTorch's i, f, g, o."""
        w, bias, h = (torch.from_numpy(blob.data.copy()) for blob in layer.blobs)
        D = h.shape[1]
        i, f, o, g = torch.arange(4 * D).split(D)
        order = torch.cat([i, f, g, o])
        module = nn.LSTM(w.shape[1], D)
        with torch.no_grad():
            module.weight_ih_l0.copy_(w[order])
            module.weight_hh_l0.copy_(h[order])
            module.bias_ih_l0.copy_(bias[order])
            module.bias_hh_l0.zero_()
        return lambda x, cont: module(x)[0]

    def _dropout(self, layer: Layer) -> Operation:
        return lambda x: F.dropout(x, layer.param.dropout_ratio, self.training)

    def _split(self, layer: Layer) -> Operation:
        return self._identity

    def _concat(self, layer: Layer) -> Operation:
        return lambda *xs: torch.cat(xs, 1)

    def _eltwise(self, layer: Layer) -> Operation:
        return torch.add

    def _lrn(self, layer: Layer) -> Operation:
        p = layer.param
        return lambda x: F.local_response_norm(x, p.local_size, p.alpha, p.beta, p.k)

    def _softmaxwithloss(self, layer: Layer) -> Operation:
        return lambda x, label: F.cross_entropy(x, label.long())

    def _handmodel(self, layer: Layer) -> Operation:
        return TorchHand(layer.skeleton)  # type: ignore[attr-defined]

    def _euclideanloss(self, layer: Layer) -> Operation:
        return lambda x, y: ((x - y) ** 2).sum() / (2 * len(x))

    def _physlimit(self, layer: Layer) -> Operation:
        lower, upper = torch.from_numpy(layer.lower), torch.from_numpy(layer.upper)  # type: ignore[attr-defined]
        return lambda x: (torch.relu(x - upper).sum() + torch.relu(lower - x).sum()) / len(x)


class TorchHand:
    """Forward kinematics for autograd: transforms (4, 4) of all free motions, then one product per
    depth of the tree.

    A motion by theta is A_1 + A_cos cos theta + A_sin sin theta + A_theta theta, as in
    export/onnx/hand.py.
    """

    def __init__(self, skeleton: Skeleton) -> None:
        steps, self.last, offsets = steps_of(skeleton, skeleton.bones)
        depths = np.array([step.depth for step in steps])  # ascending
        edges = np.searchsorted(depths, range(depths[-1] + 2))
        self.levels = [slice(first, end) for first, end in itertools.pairwise(edges)]
        self.parents = [
            [step.parent - above.start for step in steps[level]]
            for above, level in zip(self.levels, self.levels[1:])
        ]
        self.dofs = [step.dof for step in steps]
        self.parts = torch.tensor(
            np.stack([step.parts for step in steps], axis=1), dtype=torch.float32
        )
        self.initial = torch.tensor(skeleton.initial[self.dofs], dtype=torch.float32)
        self.offsets = torch.tensor(offsets[:, None], dtype=torch.float32)

    def __call__(self, x: Tensor) -> Tensor:
        """Map inputs (N, D) to joints (N, 3 K)."""
        theta = (x[:, self.dofs] + self.initial)[..., None, None]
        one, cosine, sine, angle = self.parts
        own = one + torch.cos(theta) * cosine + torch.sin(theta) * sine + theta * angle
        worlds = [own[:, self.levels[0]]]
        for level, parents in zip(self.levels[1:], self.parents):
            worlds.append(worlds[-1][:, parents] @ own[:, level])
        ends = (torch.cat(worlds, 1)[:, self.last] * self.offsets).sum(-1)
        return ends[..., :3].reshape(len(x), -1)
