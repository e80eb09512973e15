"""A net in PyTorch, with the same weights, made from its layers."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from netlib.layer import TRAIN, Layer
from netlib.net import Net

Operation = Callable[..., Tensor]


class TorchGraph(nn.Module):
    """The layers of a net in PyTorch. BatchNorm and a Scale behind it are one operation.

    pairs  name of a layer and number of a parameter -> PyTorch's parameter
    """

    def __init__(self, net: Net) -> None:
        super().__init__()
        self.outputs = net.outputs
        self.pairs: dict[tuple[str, int], nn.Parameter] = {}
        self.steps: list[tuple[Operation, tuple[str, ...], tuple[str, ...]]] = []
        layers = [layer for layer in net.layers if layer.type != "Input"]
        for before, layer in zip([None, *layers], layers):
            bottom = layer.spec.bottom
            if layer.type == "Scale" and before is not None and before.type == "BatchNorm":
                bottom = self.steps.pop()[1]
                step = self._norm(before, layer)
            else:
                step = getattr(self, f"_{layer.type.lower()}")(layer)
            self.steps.append((step, bottom, layer.spec.top))

    def forward(self, **inputs: Tensor) -> Tensor:
        """The net's only output."""
        values = dict(inputs)
        for step, bottoms, tops in self.steps:
            result = step(*(values[name] for name in bottoms))
            values.update(dict.fromkeys(tops, result))
        return values[self.outputs[0]]

    def _param(self, layer: Layer, number: int) -> Tensor | None:
        """PyTorch's copy of a parameter, None if the layer has no such parameter."""
        if number >= len(layer.blobs):
            return None
        found = nn.Parameter(torch.from_numpy(layer.blobs[number].data.copy()))
        self.register_parameter(f"{layer.name}_{number}", found)
        self.pairs[layer.name, number] = found
        return found

    def _convolution(self, layer: Layer) -> Operation:
        w, b = self._param(layer, 0), self._param(layer, 1)
        options = {"stride": layer.stride, "padding": layer.pad, "groups": layer.param.group}  # type: ignore[attr-defined]
        return lambda x: F.conv2d(x, w, b, **options)  # type: ignore[arg-type]

    def _deconvolution(self, layer: Layer) -> Operation:
        w, b = self._param(layer, 0), self._param(layer, 1)
        options = {"stride": layer.stride, "padding": layer.pad, "groups": layer.param.group}  # type: ignore[attr-defined]
        return lambda x: F.conv_transpose2d(x, w, b, **options)  # type: ignore[arg-type]

    def _innerproduct(self, layer: Layer) -> Operation:
        w, b = self._param(layer, 0), self._param(layer, 1)
        return lambda x: F.linear(x.flatten(1), w, b)  # type: ignore[arg-type]

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
        whole, is_max = layer.param.global_pooling, layer.is_max  # type: ignore[attr-defined]
        if whole:
            return lambda x: x.mean((2, 3), keepdim=True)
        pool = F.max_pool2d if is_max else F.avg_pool2d
        return lambda x: pool(x, kernel, stride, pad, ceil_mode=True)

    def _relu(self, layer: Layer) -> Operation:
        return torch.relu

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
        return lambda x, label: F.cross_entropy(x, label)
