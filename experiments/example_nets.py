"""The nets of the benchmarks: eight public classifiers, one for segmentation, six kinds of which
OpenCV or PyTorch were faster, four small ones for training, and the paper's.

The public ones have the form in which their authors published them: in MobileNet v2 and
DenseNet-121, BatchNorm writes a blob of its own. Weights are random, so nothing is downloaded;
times do not depend on them.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from experiments.net_builder import FILLER, NetBuilder
from handpose.synthetic.files import generate
from handpose.synthetic.generator import Generator
from netlib.blob import Array
from netlib.files.paths import ROOT

# GoogLeNet's modules: outputs of the convolutions, in the order of _googlenet
INCEPTION = (
    (64, 96, 128, 16, 32, 32),
    (128, 128, 192, 32, 96, 64),
    (192, 96, 208, 16, 48, 64),
    (160, 112, 224, 24, 64, 64),
    (128, 128, 256, 24, 64, 64),
    (112, 144, 288, 32, 64, 64),
    (256, 160, 320, 32, 128, 128),
    (256, 160, 320, 32, 128, 128),
    (384, 192, 384, 48, 128, 128),
)
# MobileNet v2's blocks: factor of the width inside, outputs, repeats, stride of the first
BOTTLENECKS = (
    (1, 16, 1, 1),
    (6, 24, 2, 2),
    (6, 32, 3, 2),
    (6, 64, 4, 2),
    (6, 96, 3, 1),
    (6, 160, 3, 2),
    (6, 320, 1, 1),
)

# Each function adds the layers of a net, whose input is "data", and returns the name of its output.


def _caffenet(net: NetBuilder) -> str:
    x = net.lrn(net.pool(net.conv("data", 96, 11, stride=4), 3, 2))
    x = net.lrn(net.pool(net.conv(x, 256, 5, pad=2, group=2), 3, 2))
    x = net.conv(net.conv(x, 384, 3, pad=1), 384, 3, pad=1, group=2)
    x = net.pool(net.conv(x, 256, 3, pad=1, group=2), 3, 2)
    return net.product(net.hidden(net.hidden(x, 4096), 4096), 1000)


def _googlenet(net: NetBuilder) -> str:
    x = net.lrn(net.pool(net.conv("data", 64, 7, stride=2, pad=3), 3, 2))
    x = net.pool(net.lrn(net.conv(net.conv(x, 64, 1), 192, 3, pad=1)), 3, 2)
    for number, (a, b, c, d, e, f) in enumerate(INCEPTION):
        if number in (2, 7):
            x = net.pool(x, 3, 2)
        one = net.conv(x, a, 1)
        three = net.conv(net.conv(x, b, 1), c, 3, pad=1)
        five = net.conv(net.conv(x, d, 1), e, 5, pad=2)
        pooled = net.conv(net.pool(x, 3, 1, pad=1), f, 1)
        x = net.add("Concat", [one, three, five, pooled])
    return net.product(net.average(x), 1000)


def _squeezenet(net: NetBuilder) -> str:
    x = net.pool(net.conv("data", 64, 3, stride=2), 3, 2)
    for number, few in enumerate((16, 16, 32, 32, 48, 48, 64, 64)):
        if number in (2, 4):
            x = net.pool(x, 3, 2)
        x = net.conv(x, few, 1)
        one, three = net.conv(x, 4 * few, 1), net.conv(x, 4 * few, 3, pad=1)
        x = net.add("Concat", [one, three])
    return net.average(net.conv(x, 1000, 1))


def _mobilenet_v1(net: NetBuilder) -> str:
    x, channels = net.conv("data", 32, 3, stride=2, pad=1, batch_norm=True), 32
    for count in (64, 128, 128, 256, 256, *(512,) * 6, 1024, 1024):
        stride = 2 if count > channels > 32 else 1
        x = net.conv(x, channels, 3, stride=stride, pad=1, group=channels, batch_norm=True)
        x, channels = net.conv(x, count, 1, batch_norm=True), count
    return net.product(net.average(x), 1000)


def _mobilenet_v2(net: NetBuilder) -> str:
    net.batch_norm_in_place = False
    x, channels = net.conv("data", 32, 3, stride=2, pad=1, batch_norm=True), 32
    for wider, count, repeats, first in BOTTLENECKS:
        for stride in (first, *(1,) * (repeats - 1)):
            wide = channels * wider
            y = net.conv(x, wide, 1, batch_norm=True) if wider > 1 else x
            y = net.conv(y, wide, 3, stride=stride, pad=1, group=wide, batch_norm=True)
            y = net.conv(y, count, 1, batch_norm=True, relu=False)
            x = net.add("Eltwise", [x, y]) if stride == 1 and channels == count else y
            channels = count
    return net.product(net.average(net.conv(x, 1280, 1, batch_norm=True)), 1000)


def _resnet50(net: NetBuilder) -> str:
    x = net.pool(net.conv("data", 64, 7, stride=2, pad=3, batch_norm=True), 3, 2)
    for number, (few, blocks) in enumerate(((64, 3), (128, 4), (256, 6), (512, 3))):
        for block in range(blocks):
            stride = 2 if number and not block else 1
            y = net.conv(x, few, 1, stride=stride, batch_norm=True)
            y = net.conv(y, few, 3, pad=1, batch_norm=True)
            y = net.conv(y, 4 * few, 1, batch_norm=True, relu=False)
            x = x if block else net.conv(x, 4 * few, 1, stride=stride, batch_norm=True, relu=False)
            x = net.relu(net.add("Eltwise", [x, y]))
    return net.product(net.average(x), 1000)


def _vgg16(net: NetBuilder) -> str:
    x = "data"
    for count, repeats in ((64, 2), (128, 2), (256, 3), (512, 3), (512, 3)):
        for _ in range(repeats):
            x = net.conv(x, count, 3, pad=1)
        x = net.pool(x, 2, 2)
    return net.product(net.hidden(net.hidden(x, 4096), 4096), 1000)


def _densenet121(net: NetBuilder) -> str:
    net.batch_norm_in_place = False
    x, channels = net.pool(net.conv("data", 64, 7, stride=2, pad=3, batch_norm=True), 3, 2), 64
    for number, repeats in enumerate((6, 12, 24, 16)):
        if number:
            channels //= 2
            x = net.conv(net.batch_norm_relu(x), channels, 1, relu=False)
            x = net.pool(x, 2, 2, kind="AVE")
        for _ in range(repeats):
            y = net.conv(net.batch_norm_relu(x), 128, 1, batch_norm=True)
            y = net.conv(y, 32, 3, pad=1, relu=False)
            x, channels = net.add("Concat", [x, y]), channels + 32
    return net.product(net.average(net.batch_norm_relu(x)), 1000)


def _unet(net: NetBuilder) -> str:
    x = "data"
    skips: list[str] = []
    for count in (32, 64, 128, 256):
        skips.append(net.conv(net.conv(x, count, 3, pad=1), count, 3, pad=1))
        x = net.pool(skips[-1], 2, 2)
    x = net.conv(x, 512, 3, pad=1)
    for count in (256, 128, 64, 32):
        options = f"num_output: {count} kernel_size: 2 stride: 2 {FILLER}"
        upsampled = net.add("Deconvolution", [x], f"convolution_param {{ {options} }}")
        x = net.add("Concat", [upsampled, skips.pop()])
        x = net.conv(net.conv(x, count, 3, pad=1), count, 3, pad=1)
    return net.conv(x, 2, 1, relu=False)


def _small(net: NetBuilder) -> str:
    """As the second net of MTCNN, which runs for each face."""
    x = net.pool(net.conv("data", 28, 3), 3, 2)
    x = net.conv(net.pool(net.conv(x, 48, 3), 3, 2), 64, 2)
    return net.product(net.hidden(x, 128), 6)


def _three_dimensional(net: NetBuilder) -> str:
    x = net.conv(net.conv("data", 16, 3, pad=1), 32, 3, stride=2, pad=1)
    return net.conv(net.conv(x, 32, 3, pad=1), 64, 3, stride=2, pad=1)


def _activated(kind: str) -> Callable[[NetBuilder], str]:
    """Convolutions with another activation than ReLU."""

    def layers(net: NetBuilder) -> str:
        x = "data"
        for count in (16, 32, 32):
            x = net.add(kind, [net.conv(x, count, 3, pad=1, relu=False)])
        return x

    return layers


def _dilated(net: NetBuilder) -> str:
    x = net.conv("data", 64, 3, pad=1)
    for dilation in (2, 4, 4):
        options = f"num_output: 64 kernel_size: 3 pad: {dilation} dilation: {dilation} {FILLER}"
        x = net.relu(net.add("Convolution", [x], f"convolution_param {{ {options} }}"))
    return x


def _lstm(net: NetBuilder) -> str:
    """One stream of 100 steps."""
    net.input("cont", 100, 1)
    filler = 'weight_filler { type: "uniform" min: -0.2 max: 0.2 }'
    options = f"recurrent_param {{ num_output: 128 {filler} }}"
    return net.add("LSTM", ["data", "cont"], options)


def _lenet(net: NetBuilder) -> str:
    x = net.pool(net.conv("data", 20, 5, relu=False), 2, 2)
    x = net.pool(net.conv(x, 50, 5, relu=False), 2, 2)
    return net.product(net.hidden(x, 500), 10)


def _cifar10(net: NetBuilder) -> str:
    x = net.relu(net.pool(net.conv("data", 32, 5, pad=2, relu=False), 3, 2))
    x = net.pool(net.conv(x, 32, 5, pad=2), 3, 2, kind="AVE")
    x = net.pool(net.conv(x, 64, 5, pad=2), 3, 2, kind="AVE")
    return net.product(net.product(x, 64), 10)


def _vgg(net: NetBuilder) -> str:
    x = "data"
    for count in (64, 128):
        x = net.pool(net.conv(net.conv(x, count, 3, pad=1), count, 3, pad=1), 2, 2)
    return net.product(net.hidden(x, 256), 10)


def _residual(net: NetBuilder) -> str:
    x = net.conv("data", 32, 3, pad=1, batch_norm=True)
    y = net.conv(x, 32, 3, pad=1, batch_norm=True)
    y = net.conv(y, 32, 3, pad=1, batch_norm=True, relu=False)
    return net.product(net.average(net.relu(net.add("Eltwise", [x, y]))), 10)


# ------------------------------------------------------------------------------ the paper's network


@functools.cache
def hands(count: int) -> tuple[Array, Array]:
    """Depth crops (N, 1, 128, 128) of synthetic hands, and their joints (N, 93)."""
    blocks = list(generate(count, Generator(seed=0, split="train")))
    depth = np.concatenate([block.depth for block in blocks]).reshape(count, 1, 128, 128)
    return depth, np.concatenate([block.joint for block in blocks]).reshape(count, 93)


def hand_training(batch: int) -> Callable[[Path], str]:
    """The paper's network in training, which reads two batches from a file."""

    def text(folder: Path) -> str:
        data = folder / f"hands_{batch}.txt"
        if not data.exists():
            with h5py.File(data.with_suffix(".h5"), "w") as file:
                file["depth"], file["joint"] = hands(2 * batch)
            data.write_text(f"{data.stem}.h5\n", encoding="utf-8")
        net = (ROOT / "prototxt" / "nyu_train_test.prototxt").read_text(encoding="utf-8")
        net = net.replace("batch_size: 512", f"batch_size: {batch}")
        return re.sub("data/nyu/[a-z]*.txt", data.as_posix(), net)

    return text


def hand_deploy(folder: Path) -> str:
    """The paper's network for prediction, with fillers for which its outputs vary
    between images.
    """
    net = (ROOT / "prototxt" / "nyu_deploy.prototxt").read_text(encoding="utf-8")
    return net.replace("std: 0.001", "std: 0.03")


# ----------------------------------------------------------------------------------------- all nets


@dataclass(frozen=True)
class Example:
    """A net of the benchmarks.

    text    writes its data to a folder and returns its prototxt
    trains  a training step is timed instead of a forward pass
    batch   number of hands that it predicts; 0: its inputs are random numbers
    """

    name: str
    text: Callable[[Path], str]
    trains: bool = False
    batch: int = 0


def ordinary(
    name: str, layers: Callable[[NetBuilder], str], *shape: int, trains: bool = False
) -> Example:
    """A net with random inputs; in training, with labels of ten classes and SoftmaxWithLoss."""

    def text(folder: Path) -> str:
        net = NetBuilder(*shape)
        output = layers(net)
        if trains:
            net.input("label", shape[0])
            net.add("SoftmaxWithLoss", [output, "label"], top="loss")
        return "\n".join(net.lines)

    return Example(name, text, trains)


NETS = {
    example.name: example
    for example in (
        ordinary("CaffeNet", _caffenet, 10, 3, 227, 227),
        ordinary("GoogLeNet", _googlenet, 10, 3, 224, 224),
        ordinary("SqueezeNet", _squeezenet, 10, 3, 227, 227),
        ordinary("MobileNet-v1", _mobilenet_v1, 1, 3, 224, 224),
        ordinary("MobileNet-v2", _mobilenet_v2, 1, 3, 224, 224),
        ordinary("ResNet-50", _resnet50, 1, 3, 224, 224),
        ordinary("VGG-16", _vgg16, 1, 3, 224, 224),
        ordinary("DenseNet-121", _densenet121, 1, 3, 224, 224),
        ordinary("U-Net", _unet, 1, 3, 256, 256),
        ordinary("small", _small, 1, 3, 24, 24),
        ordinary("3-D", _three_dimensional, 1, 3, 16, 56, 56),
        ordinary("sigmoid", _activated("Sigmoid"), 1, 3, 96, 96),
        ordinary("swish", _activated("Swish"), 1, 3, 96, 96),
        ordinary("dilated", _dilated, 1, 3, 64, 64),
        ordinary("LSTM", _lstm, 100, 1, 64),
        ordinary("LeNet", _lenet, 64, 1, 28, 28, trains=True),
        ordinary("CIFAR-10", _cifar10, 100, 3, 32, 32, trains=True),
        ordinary("VGG-like", _vgg, 16, 3, 64, 64, trains=True),
        ordinary("residual", _residual, 32, 3, 32, 32, trains=True),
        *(Example(f"hand-{batch}", hand_deploy, batch=batch) for batch in (1, 64, 512)),
        *(
            Example(f"hand-training-{batch}", hand_training(batch), trains=True)
            for batch in (64, 512)
        ),
    )
}
