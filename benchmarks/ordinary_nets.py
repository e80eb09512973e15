"""Ordinary nets as text: eight public classifiers of images, a net for segmentation, and four small nets for training.

Weights are random, so that nothing is downloaded; times do not depend on them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from netlib.net import Net

FILLER = 'weight_filler { type: "msra" }'


class Text:
    """The layers of a net. Every method adds layers behind the blob ``bottom`` and returns the name of the top."""

    def __init__(self, batch: int, *image: int) -> None:
        sizes = " ".join(f"dim: {n}" for n in (batch, *image))
        self.lines = [f'layer {{ name: "data" type: "Input" top: "data" input_param {{ shape {{ {sizes} }} }} }}']

    def add(self, type_: str, bottoms: Sequence[str], options: str = "", top: str = "") -> str:
        """Add a layer; by default with a new top that has its name."""
        name = f"n{len(self.lines)}"
        blobs = " ".join([*(f'bottom: "{bottom}"' for bottom in bottoms), f'top: "{top or name}"'])
        self.lines.append(f'layer {{ name: "{name}" type: "{type_}" {blobs} {options} }}')
        return top or name

    def relu(self, bottom: str) -> str:
        """ReLU in place."""
        return self.add("ReLU", [bottom], top=bottom)

    def conv(self, bottom: str, count: int, kernel: int, stride: int = 1, pad: int = 0, group: int = 1,
             relu: bool = True, norm: bool = False) -> str:
        """Convolution, with BatchNorm and Scale in place of a bias, and a ReLU."""
        options = f"num_output: {count} kernel_size: {kernel} stride: {stride} pad: {pad} group: {group}"
        bias = "bias_term: false" if norm else ""
        top = self.add("Convolution", [bottom], f"convolution_param {{ {options} {bias} {FILLER} }}")
        if norm:
            self.norm_and_scale(top, top)
        return self.relu(top) if relu else top

    def normed(self, bottom: str) -> str:
        """BatchNorm, and behind it in place Scale and ReLU."""
        return self.relu(self.norm_and_scale(bottom))

    def norm_and_scale(self, bottom: str, top: str = "") -> str:
        """BatchNorm, and behind it in place Scale."""
        top = self.add("BatchNorm", [bottom], top=top)
        return self.add("Scale", [top], "scale_param { bias_term: true }", top=top)

    def pool(self, bottom: str, kernel: int, stride: int, pad: int = 0, kind: str = "MAX") -> str:
        """Pooling; over the whole map if ``kernel`` is 0."""
        windows = f"kernel_size: {kernel} stride: {stride} pad: {pad}" if kernel else "global_pooling: true"
        return self.add("Pooling", [bottom], f"pooling_param {{ pool: {kind} {windows} }}")

    def product(self, bottom: str, count: int) -> str:
        """InnerProduct."""
        return self.add("InnerProduct", [bottom], f"inner_product_param {{ num_output: {count} {FILLER} }}")

    def norm(self, bottom: str) -> str:
        """Local response normalization with AlexNet's options."""
        return self.add("LRN", [bottom], "lrn_param { local_size: 5 alpha: 0.0001 beta: 0.75 }")


def caffenet() -> Text:
    """CaffeNet, batch 10."""
    net = Text(10, 3, 227, 227)
    x = net.norm(net.pool(net.conv("data", 96, 11, stride=4), 3, 2))
    x = net.norm(net.pool(net.conv(x, 256, 5, pad=2, group=2), 3, 2))
    x = net.conv(net.conv(x, 384, 3, pad=1), 384, 3, pad=1, group=2)
    x = net.pool(net.conv(x, 256, 3, pad=1, group=2), 3, 2)
    net.product(net.relu(net.product(net.relu(net.product(x, 4096)), 4096)), 1000)
    return net


def googlenet() -> Text:
    """GoogLeNet, batch 10."""
    net = Text(10, 3, 224, 224)
    x = net.norm(net.pool(net.conv("data", 64, 7, stride=2, pad=3), 3, 2))
    x = net.pool(net.norm(net.conv(net.conv(x, 64, 1), 192, 3, pad=1)), 3, 2)
    for number, (a, b, c, d, e, f) in enumerate(INCEPTION):
        if number in (2, 7):
            x = net.pool(x, 3, 2)
        one, three = net.conv(x, a, 1), net.conv(net.conv(x, b, 1), c, 3, pad=1)
        five, pooled = net.conv(net.conv(x, d, 1), e, 5, pad=2), net.conv(net.pool(x, 3, 1, pad=1), f, 1)
        x = net.add("Concat", [one, three, five, pooled])
    net.product(net.pool(x, 0, 1, kind="AVE"), 1000)
    return net


def squeezenet() -> Text:
    """SqueezeNet 1.1, batch 10."""
    net = Text(10, 3, 227, 227)
    x = net.pool(net.conv("data", 64, 3, stride=2), 3, 2)
    for number, few in enumerate((16, 16, 32, 32, 48, 48, 64, 64)):
        if number in (2, 4):
            x = net.pool(x, 3, 2)
        x = net.conv(x, few, 1)
        x = net.add("Concat", [net.conv(x, 4 * few, 1), net.conv(x, 4 * few, 3, pad=1)])
    net.pool(net.conv(x, 1000, 1), 0, 1, kind="AVE")
    return net


def mobilenet_v1() -> Text:
    """MobileNet v1, one image."""
    net = Text(1, 3, 224, 224)
    x, channels = net.conv("data", 32, 3, stride=2, pad=1, norm=True), 32
    for count in (64, 128, 128, 256, 256, *(512,) * 6, 1024, 1024):
        stride = 2 if count > channels > 32 else 1
        x = net.conv(x, channels, 3, stride=stride, pad=1, group=channels, norm=True)
        x, channels = net.conv(x, count, 1, norm=True), count
    net.product(net.pool(x, 0, 1, kind="AVE"), 1000)
    return net


def mobilenet_v2() -> Text:
    """MobileNet v2 with ReLU, one image."""
    net = Text(1, 3, 224, 224)
    x, channels = net.conv("data", 32, 3, stride=2, pad=1, norm=True), 32
    for wider, count, repeats, first in ((1, 16, 1, 1), (6, 24, 2, 2), (6, 32, 3, 2), (6, 64, 4, 2), (6, 96, 3, 1),
                                         (6, 160, 3, 2), (6, 320, 1, 1)):
        for stride in (first, *(1,) * (repeats - 1)):
            wide = channels * wider
            y = net.conv(x, wide, 1, norm=True) if wider > 1 else x
            y = net.conv(y, wide, 3, stride=stride, pad=1, group=wide, norm=True)
            y = net.conv(y, count, 1, norm=True, relu=False)
            x = net.add("Eltwise", [x, y]) if stride == 1 and channels == count else y
            channels = count
    net.product(net.pool(net.conv(x, 1280, 1, norm=True), 0, 1, kind="AVE"), 1000)
    return net


def resnet50() -> Text:
    """ResNet-50, one image."""
    net = Text(1, 3, 224, 224)
    x = net.pool(net.conv("data", 64, 7, stride=2, pad=3, norm=True), 3, 2)
    for number, (few, blocks) in enumerate(((64, 3), (128, 4), (256, 6), (512, 3))):
        for block in range(blocks):
            stride = 2 if number and not block else 1
            y = net.conv(net.conv(x, few, 1, stride=stride, norm=True), few, 3, pad=1, norm=True)
            y = net.conv(y, 4 * few, 1, norm=True, relu=False)
            x = x if block else net.conv(x, 4 * few, 1, stride=stride, norm=True, relu=False)
            x = net.relu(net.add("Eltwise", [x, y]))
    net.product(net.pool(x, 0, 1, kind="AVE"), 1000)
    return net


def vgg16() -> Text:
    """VGG-16, one image."""
    net, x = Text(1, 3, 224, 224), "data"
    for count, repeats in ((64, 2), (128, 2), (256, 3), (512, 3), (512, 3)):
        for _ in range(repeats):
            x = net.conv(x, count, 3, pad=1)
        x = net.pool(x, 2, 2)
    net.product(net.relu(net.product(net.relu(net.product(x, 4096)), 4096)), 1000)
    return net


def densenet121() -> Text:
    """DenseNet-121, one image: BatchNorm, Scale and ReLU in front of each convolution."""
    net = Text(1, 3, 224, 224)
    x, channels = net.pool(net.conv("data", 64, 7, stride=2, pad=3, norm=True), 3, 2), 64
    for number, repeats in enumerate((6, 12, 24, 16)):
        if number:
            channels //= 2
            x = net.pool(net.conv(net.normed(x), channels, 1, relu=False), 2, 2, kind="AVE")
        for _ in range(repeats):
            y = net.conv(net.conv(net.normed(x), 128, 1, norm=True), 32, 3, pad=1, relu=False)
            x, channels = net.add("Concat", [x, y]), channels + 32
    net.product(net.pool(net.normed(x), 0, 1, kind="AVE"), 1000)
    return net


def unet() -> Text:
    """A U-Net with deconvolutions, one image of 256 x 256."""
    net, x = Text(1, 3, 256, 256), "data"
    passed: list[str] = []
    for count in (32, 64, 128, 256):
        passed.append(net.conv(net.conv(x, count, 3, pad=1), count, 3, pad=1))
        x = net.pool(passed[-1], 2, 2)
    x = net.conv(x, 512, 3, pad=1)
    for count in (256, 128, 64, 32):
        wider = net.add(
            "Deconvolution", [x], f"convolution_param {{ num_output: {count} kernel_size: 2 stride: 2 {FILLER} }}"
        )
        x = net.conv(net.conv(net.add("Concat", [wider, passed.pop()]), count, 3, pad=1), count, 3, pad=1)
    net.conv(x, 2, 1, relu=False)
    return net


def lenet() -> Text:
    """LeNet, batch 64."""
    net = Text(64, 1, 28, 28)
    x = net.pool(net.conv(net.pool(net.conv("data", 20, 5, relu=False), 2, 2), 50, 5, relu=False), 2, 2)
    return _loss(net, net.product(net.relu(net.product(x, 500)), 10))


def cifar10() -> Text:
    """CIFAR-10 quick, batch 100."""
    net = Text(100, 3, 32, 32)
    x = net.relu(net.pool(net.conv("data", 32, 5, pad=2, relu=False), 3, 2))
    x = net.pool(net.conv(x, 32, 5, pad=2), 3, 2, kind="AVE")
    x = net.pool(net.conv(x, 64, 5, pad=2), 3, 2, kind="AVE")
    return _loss(net, net.product(net.product(x, 64), 10))


def vgg() -> Text:
    """Four 3 x 3 convolutions as in VGG, batch 16."""
    net = Text(16, 3, 64, 64)
    x = "data"
    for count in (64, 128):
        x = net.pool(net.conv(net.conv(x, count, 3, pad=1), count, 3, pad=1), 2, 2)
    return _loss(net, net.product(net.relu(net.product(x, 256)), 10))


def residual() -> Text:
    """Three 3 x 3 convolutions with BatchNorm and Scale, and a residual sum, batch 32."""
    net = Text(32, 3, 32, 32)
    x = net.conv("data", 32, 3, pad=1, norm=True)
    y = net.conv(net.conv(x, 32, 3, pad=1, norm=True), 32, 3, pad=1, norm=True, relu=False)
    x = net.relu(net.add("Eltwise", [x, y]))
    return _loss(net, net.product(net.pool(x, 0, 1, kind="AVE"), 10))


def _loss(net: Text, scores: str) -> Text:
    """Add labels of ten classes and SoftmaxWithLoss."""
    batch = net.lines[0].split("dim: ")[1].split()[0]
    net.lines.append(f'layer {{ name: "label" type: "Input" top: "label" input_param {{ shape {{ dim: {batch} }} }} }}')
    net.add("SoftmaxWithLoss", [scores, "label"], top="loss")
    return net


INCEPTION = (
    (64, 96, 128, 16, 32, 32), (128, 128, 192, 32, 96, 64), (192, 96, 208, 16, 48, 64), (160, 112, 224, 24, 64, 64),
    (128, 128, 256, 24, 64, 64), (112, 144, 288, 32, 64, 64), (256, 160, 320, 32, 128, 128),
    (256, 160, 320, 32, 128, 128), (384, 192, 384, 48, 128, 128),
)


@dataclass(frozen=True)
class Ordinary:
    """A net of the benchmark: its name, its layers, whether its training is timed or its forward pass."""

    name: str
    text: Callable[[], Text]
    trains: bool = False


NETS = (
    Ordinary("CaffeNet", caffenet), Ordinary("GoogLeNet", googlenet), Ordinary("SqueezeNet", squeezenet),
    Ordinary("MobileNet-v1", mobilenet_v1), Ordinary("MobileNet-v2", mobilenet_v2), Ordinary("ResNet-50", resnet50),
    Ordinary("VGG-16", vgg16), Ordinary("DenseNet-121", densenet121), Ordinary("U-Net", unet),
    Ordinary("LeNet", lenet, True), Ordinary("CIFAR-10", cifar10, True), Ordinary("VGG-like", vgg, True),
    Ordinary("residual", residual, True),
)


def fill(net: Net, rng: np.random.Generator) -> None:
    """Fill the statistics of BatchNorm layers, the gains of Scale layers, and the biases with random numbers."""
    for layer in net.layers:
        for number, param in enumerate(layer.blobs):
            if layer.type == "BatchNorm":
                param.data[...] = (rng.normal(0, 0.1, param.shape), rng.uniform(0.5, 1.5, param.shape), 1)[number]
            elif layer.type == "Scale" or number:
                param.data[...] = (layer.type == "Scale" and number == 0) + rng.normal(0, 0.1, param.shape)
