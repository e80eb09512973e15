"""Random nets, used at random, under the plain engine and the fast one on 1 and on 4 threads.

A *program* is a net and a list of operations: passes over images of changing sizes, parts of passes, values written
between them, blobs read, parameters shared. After every operation the three nets must agree: on the values returned or
errors raised, on all parameters and their gradients, on all outputs. Plain and fast agree to rounding in float64, fast
on 1 and on 4 threads bit for bit.

    python -m tests.fast.test_random_programs 123         one program and what it does

Uses that the documents exclude are not generated (docs/net.md): a gradient read after another forward pass or after the
weights changed, a blob written after a pass that did not store all blobs, and inputs given
as views of each other.
"""

from __future__ import annotations

import functools
import logging
import sys
from collections.abc import Callable
from random import Random
from typing import Any

import numpy as np
import pytest

import netlib
from fast import parallel, slices
from netlib.proto import prototxt
from netlib.proto.messages import NetParameter
from netlib.proto.net_parameter import load_parameter
from tests.support.nets import inputs

PER_TEST = 50
TOLERANCE = 1e-9  # of the largest value of an array, or of 1 where all are smaller
OPERATIONS = {  # weights of the choice
    "forward": 8, "forward new sizes": 4, "forward new count": 3, "write input, forward": 3, "forward of a view": 1,
    "forward part": 3, "backward": 9, "backward part": 3, "clear": 3, "read data": 4, "read diff": 2, "write data": 2,
    "write diff": 1, "write parameter": 2, "share": 1, "forward, reshape, backward": 2,
}

POOLS = {count: parallel.Workers(count - 1, "netlib") for count in (1, 4)}  # started once: a program has ten changes

# Kinds of layers, and weights of their choice.
ELEMENTWISE = {"relu": "ReLU", "leaky": "ReLU", "relu6": "ReLU6", "tanh": "TanH", "sigmoid": "Sigmoid",
               "power": "Power", "scale": "Scale", "bnll": "BNLL", "dropout": "Dropout", "lrn": "LRN",
               "norm": "BatchNorm", "bn": "BN", "prelu": "PReLU", "bias": "Bias", "softmax": "Softmax",
               "unit": "Normalize"}
KINDS = dict.fromkeys(ELEMENTWISE, 1) | {
    "relu": 5, "power": 2, "conv": 5, "two bottoms": 1, "shared": 1, "strided": 1, "max": 4, "ave": 1, "eltwise": 1,
    "concat": 1, "product": 1,
}
BN_OPTIONS = [
    "bn_mode: LEARN scale_filler { value: 2 }",
    "bn_mode: INFERENCE scale_filler { value: 2 }",
    "momentum: 0.9 slope_filler { value: 2 }",
    "frozen: true slope_filler { value: 2 }",
]
LOSS = """layer { name: "l%s" type: "Reduction" bottom: "%s" top: "l%s" loss_weight: %d
    reduction_param { operation: SUMSQ } }"""


# ---------------------------------------------------------------------------------------------- nets


class NetText:
    """A random net. ``shapes`` are those of its blobs without the number of items, as far as they are known."""

    def __init__(self, rng: Random) -> None:
        self.rng = rng
        self.lines: list[str] = []
        self.shapes: dict[str, tuple[int, int, int]] = {}  # of blobs that a later layer may still read
        self.fixed_size = False  # an inner product only takes images of one size
        self.window = 0  # of the pooling of a depth image, whose sides are multiples of this
        self.inputs: list[str] = []
        self.read: set[str] = set()  # blobs that some layer reads: a later one cannot overwrite them
        if rng.random() < 0.25:
            self._depth_image()
        else:
            self._any()
            if rng.random() < 0.4:
                self.lines.append("force_backward: true")
        for name in [name for name in self.shapes if name not in self.inputs]:
            if rng.random() < (0.15 if self.window else 0.5):
                self.lines.append(LOSS % (name, name, name, rng.choice([1, 2])))

    def _depth_image(self) -> None:
        """A convolution and a pooling that fit together, like the first ones of the hand's network: the fast engine
        skips their windows of background.

        There is no second max pooling: its choice between values that differ only by rounding would be arbitrary.
        """
        T = self.window = self.rng.choice([2, 4])
        self._input("x0", (1, T * self.rng.randint(2, 5), T * self.rng.randint(2, 5)))
        self._windows(0, "conv", "x0", kernel=T + 1)
        number = 1
        if self.rng.random() < 0.7:
            self._elementwise(number, self.rng.choice(["relu", "relu", "relu6"]), "b0")
        pooled = next(reversed(self.shapes))
        self._windows(2, "max", pooled, kernel=T)
        for number in range(3, 3 + self.rng.randint(0, 3)):
            kind = self.rng.choice(["relu", "leaky", "tanh", "sigmoid", "power", "scale"])
            self._elementwise(number, kind, next(reversed(self.shapes)))
        self._windows(9, "conv", next(reversed(self.shapes)), kernel=1)

    def _input(self, name: str, shape: tuple[int, int, int]) -> None:
        self.shapes[name] = shape
        self.inputs.append(name)
        self.lines.append(inputs(**{name: (3, *shape)}).rstrip())

    def _any(self) -> None:
        rng = self.rng
        count = rng.choice([1, 1, 1, 2, 3])
        for i in range(count):
            shape = (rng.randint(1, 3), rng.randint(5, 18), rng.randint(5, 18))
            if i and rng.random() < 0.5:
                shape = (self.shapes["x0"][0], *shape[1:])
            self._input(f"x{i}", shape)
        for number in range(rng.randint(1, 8)):
            self._add(number)

    def _add(self, number: int) -> None:
        rng, names = self.rng, list(self.shapes)
        bottom = names[-1] if rng.random() < 0.7 else rng.choice(names)
        kind = rng.choices(list(KINDS), list(KINDS.values()))[0]
        if kind in ELEMENTWISE:
            self._elementwise(number, kind, bottom)
        elif kind in ("conv", "max", "ave", "strided"):
            self._windows(number, kind, bottom)
        elif kind == "two bottoms":
            others = [name for name in names if self.shapes[name][0] == self.shapes[bottom][0]]
            self._windows(number, "conv", bottom, rng.choice(others))
        elif kind in ("eltwise", "concat"):
            others = [name for name in names if self.shapes[name] == self.shapes[bottom]]
            self._join(number, kind, bottom, rng.choice(others))
        elif kind == "shared":
            self._windows(number, "conv", bottom, shared=True)
        elif kind == "product":
            self.fixed_size = True
            self._layer(number, "InnerProduct", [bottom], [f"b{number}"], "inner_product_param { num_output: 3 "
                        'weight_filler { type: "xavier" } }')

    def _layer(self, number: int, type_: str, bottom: list[str], top: list[str], options: str = "") -> None:
        may_be_frozen = "filler" in options and "name:" not in options
        frozen = "param { lr_mult: 0 } " if may_be_frozen and self.rng.random() < 0.15 else ""
        names = " ".join([*(f'bottom: "{name}"' for name in bottom), *(f'top: "{name}"' for name in top)])
        self.lines.append(f'layer {{ name: "n{number}" type: "{type_}" {names} {frozen}{options} }}')
        self.read |= {*bottom} - {*top}

    def _elementwise(self, number: int, kind: str, bottom: str) -> None:
        rng = self.rng
        options = {
            "relu6": f"relu6_param {{ negative_slope: {rng.choice([0, 0, 0.1, -0.5])} }}",
            "leaky": f"relu_param {{ negative_slope: {rng.choice([0.1, -0.5])} }}",
            "power": f"power_param {{ scale: {rng.choice([-1, 0.5, 1])} shift: {rng.choice([0, 0.5])} "
                     f"power: {rng.choice([1, 1, 2])} }}",
            "scale": 'scale_param { bias_term: true filler { type: "uniform" min: -1 max: 2 } }',
            "bn": f"bn_param {{ {rng.choice(BN_OPTIONS)} }}",
            "dropout": "dropout_param { dropout_ratio: 0.3 }",
            "norm": rng.choice(["", "batch_norm_param { use_global_stats: true }"]),
            "unit": f"norm_param {{ across_spatial: {rng.choice(['true', 'false'])} channel_shared: false eps: 0.1 }}",
        }.get(kind, "")
        may_overwrite = bottom not in self.read and bottom not in self.inputs
        in_place = may_overwrite and kind != "lrn" and "-0.5" not in options and rng.random() < 0.7
        top = bottom if in_place else f"b{number}"
        self._layer(number, ELEMENTWISE[kind], [bottom], [top], options)
        self.shapes[top] = self.shapes.pop(bottom) if in_place else self.shapes[bottom]

    def _windows(self, number: int, kind: str, *bottoms: str, shared: bool = False, kernel: int = 0) -> None:
        rng = self.rng
        tops = [f"b{number}" if i == 0 else f"b{number}x" for i in range(len(bottoms))]
        k = kernel or rng.choice([1, 2, 2, 3, 5] if kind in ("conv", "strided") else [2, 2, 3, 4])
        stride, pad = 1, 0
        if kind in ("strided", "ave"):
            stride, pad = rng.randint(1, 2), rng.randint(0, min(1, k - 1))
        elif kind == "max":
            stride = k if kernel or rng.random() < 0.8 else rng.randint(1, k)
        if any(min(self.shapes[name][1:]) + 2 * pad < k for name in bottoms):
            return
        channels = rng.randint(1, 4) if kind in ("conv", "strided") else 0
        if channels:
            options = (f"convolution_param {{ num_output: {channels} kernel_size: {k} stride: {stride} pad: {pad} "
                       f'bias_term: {rng.choice(["true", "false"])} weight_filler {{ type: "gaussian" std: 0.5 }} '
                       'bias_filler { type: "uniform" min: -1 max: 1 } }')
        else:
            pool = "AVE" if kind == "ave" else "MAX"
            options = f"pooling_param {{ pool: {pool} kernel_size: {k} stride: {stride} pad: {pad} }}"
        if shared:  # two layers with the same weights
            options = f'param {{ name: "w{number}" }} {options}'.replace("true", "false")
            self._layer(100 + number, "Convolution", list(bottoms), [f"b{number}y"], options)
        self._layer(number, "Convolution" if channels else "Pooling", list(bottoms), tops[: len(bottoms)], options)
        for bottom, top in zip(bottoms, tops):
            C, H, W = self.shapes[bottom]
            height, width = (_windows_along(n, k, stride, pad, up=not channels) for n in (H, W))
            self.shapes[top] = (channels or C, height, width)
        if shared:
            self.shapes[f"b{number}y"] = self.shapes[f"b{number}"]

    def _join(self, number: int, kind: str, one: str, other: str) -> None:
        C, H, W = self.shapes[one]
        if kind == "eltwise":
            operation = self.rng.choice(["SUM", "PROD"])
            options = f"eltwise_param {{ operation: {operation} }}"
            self._layer(number, "Eltwise", [one, other], [f"b{number}"], options)
        else:
            self._layer(number, "Concat", [one, other], [f"b{number}"])
        self.shapes[f"b{number}"] = (C, H, W) if kind == "eltwise" else (2 * C, H, W)

    @property
    def text(self) -> str:
        return "\n".join(self.lines)


def _windows_along(size: int, kernel: int, stride: int, pad: int, up: bool) -> int:
    """Windows along an axis: rounded up for poolings, of which none begins in the padding behind the image."""
    room = size + 2 * pad - kernel
    count = (-(-room // stride) if up else room // stride) + 1
    return count - (up and pad > 0 and (count - 1) * stride >= size + pad)


# ---------------------------------------------------------------------------------------------- programs


class Program:
    """One random net under three engines, and one random use of it. Raises AssertionError where they disagree."""

    threads = (1, 1, 4)  # of the engines

    def __init__(self, seed: int, show: Callable[[str], object] = lambda line: None) -> None:
        self.rng, self.show = Random(seed), show
        self.values = np.random.default_rng(seed)
        net = NetText(self.rng)
        self.fixed_size, self.window = net.fixed_size, net.window
        show(net.text)
        param = load_parameter(prototxt.parse(net.text))
        phase = self.rng.choice([netlib.TRAIN, netlib.TRAIN, netlib.TEST])
        self.nets = self._build(param, phase, 1)
        self.others = functools.cache(lambda: self._build(param, phase, 2))  # built where parameters are shared
        for name, value in self._arrays().items():  # on constant images, rounding would decide the maxima of a pooling
            for net in self.nets:
                net.blobs[name].data[...] = value
        self.diffs_known = self.ended = False
        self.weights_kept = True  # since the last forward pass

    def _build(self, param: NetParameter, phase: int, seed: int) -> list[netlib.Net]:
        engines = ("plain", "fast", "fast")
        return [netlib.Net(param, phase, dtype=np.float64, seed=seed, engine=name) for name in engines]

    def run(self) -> None:
        """Run a forward pass, so that the tops of each Split have values, and operations, with a comparison after each.
        """
        self._forward()
        for _ in range(0 if self.ended else self.rng.randint(3, 12)):
            name = self.rng.choices(list(OPERATIONS), list(OPERATIONS.values()))[0]
            if name == "read diff" and not self.diffs_known:
                name = "read data"
            self.show(name)
            getattr(self, f"_{name.replace(', ', '_').replace(' ', '_')}")()
            if self.ended:
                return
            self._compare()
        for name in self.nets[0].blobs if not self.ended else ():
            self._same(f"data of {name}", [net.blobs[name].data for net in self.nets])
            if self.diffs_known:
                self._same(f"diff of {name}", [net.blobs[name].diff for net in self.nets])

    def _each(self, use: Callable[[netlib.Net], Any]) -> bool:
        """Apply an operation to each net and return whether it succeeded. All must return, or raise, the same."""
        found: list[Any] = []
        for net, threads in zip(self.nets, self.threads):
            parallel._helpers = POOLS[threads]
            try:
                found.append(use(net))
            except netlib.NetlibError as error:
                found.append(error)
        kinds = [type(one).__name__ for one in found]
        assert len(set(kinds)) == 1, f"returned or raised {found}"
        if isinstance(found[0], dict):
            for name in found[0]:
                self._same(name, [one[name] for one in found])
        return not isinstance(found[0], netlib.NetlibError)

    def _pass(self, use: Callable[[netlib.Net], Any]) -> None:
        """A forward pass, or a reshape. After one that fails, half of the blobs have new shapes."""
        self.diffs_known, self.weights_kept = False, True
        self.ended = not self._each(use)

    def _same(self, what: str, arrays: list[np.ndarray]) -> None:
        plain, one, four = arrays
        assert plain.shape == one.shape == four.shape, f"{what}: shapes {plain.shape}, {one.shape}, {four.shape}"
        assert np.array_equal(one, four, equal_nan=True), f"{what}: 1 and 4 threads differ"
        if np.isfinite(plain).all():
            worst = np.abs(plain - one).max(initial=0)
            assert worst <= TOLERANCE * max(np.abs(plain).max(initial=0), 1), f"{what}: differ by {worst:.3g}"
        else:
            assert not np.isfinite(one).all(), f"{what}: not finite in the plain engine only"

    def _compare(self) -> None:
        for name in self.nets[0].params:
            for i in range(len(self.nets[0].params[name])):
                self._same(f"{name}[{i}]", [net.params[name][i].data for net in self.nets])
                self._same(f"gradient of {name}[{i}]", [net.params[name][i].diff for net in self.nets])
        for name in self.nets[0].outputs:
            self._same(name, [net.blobs[name].data for net in self.nets])

    # Operations. Values are drawn once and used for every net.

    def _shape(self, name: str) -> tuple[int, ...]:
        return self.nets[0].blobs[name].shape

    def _arrays(self) -> dict[str, np.ndarray]:
        return {name: self._image(self._shape(name)) for name in self.nets[0].inputs}

    def _image(self, shape: tuple[int, ...]) -> np.ndarray:
        """Return noise; for a depth image, in front of a background of zeros, whose products are exact."""
        image = self.values.normal(size=shape)
        if self.window:
            image = -np.abs(image)
            for one in image:
                top, left = (self.rng.randrange(size) for size in shape[2:])
                one[:, top:], one[..., left:] = 0, 0
        return image

    def _forward(self) -> None:
        given = self._arrays() if self.rng.random() < 0.8 else {}
        self._pass(lambda net: net.forward(**given))

    def _forward_new_sizes(self) -> None:
        if self.fixed_size:
            return self._forward()
        step = self.window or 1
        change = step * self.rng.randint(-2, 2), step * self.rng.randint(-2, 2)
        shapes = {name: self._shape(name) for name in self.nets[0].inputs}
        if len(shapes) > 1 and self.rng.random() < 0.5:  # blobs that a layer joins must keep one size
            change = (0, 0)
        given = {}
        for name, (N, C, H, W) in shapes.items():
            least = 2 * self.window or 5
            size = max(least, H + change[0]), max(least, W + change[1])
            given[name] = self._image((N, C, *size))
        self._forward_of(given)

    def _forward_new_count(self) -> None:
        count, alike = self.rng.randint(0, 7), self.rng.random() < 0.8
        given = {}
        for name in self.nets[0].inputs:
            items = count if alike else self.rng.randint(0, 7)
            given[name] = self._image((items, *self._shape(name)[1:]))
        self._forward_of(given)

    def _forward_of(self, given: dict[str, np.ndarray]) -> None:
        """Run forward on arrays of new shapes, passed as arguments or written into blobs reshaped before."""
        by_hand = self.rng.random() < 0.3
        for net in self.nets if by_hand else []:
            for name, value in given.items():
                net.blobs[name].reshape(value.shape)
                net.blobs[name].data[...] = value
        self._pass(lambda net: net.forward(**({} if by_hand else given)))

    def _write_input(self) -> None:
        name = self.rng.choice(self.nets[0].inputs)
        value = self._image(self._shape(name))
        for net in self.nets:
            net.blobs[name].data[...] = value

    def _write_input_forward(self) -> None:
        self._write_input()
        if self.rng.random() < 0.5:
            self._pass(lambda net: net.forward())
        else:  # like a solver
            self._pass(lambda net: {"loss": np.array(net.run_forward())})

    def _forward_of_a_view(self) -> None:
        name = self.rng.choice(self.nets[0].inputs)
        self._pass(lambda net: net.forward(**{name: net.blobs[name].data[::-1]}))

    def _part(self) -> tuple[str | None, str | None]:
        names = [layer.name for layer in self.nets[0].layers]
        first, last = sorted(self.rng.randrange(len(names)) for _ in range(2))
        return (names[first] if self.rng.random() < 0.8 else None), (names[last] if self.rng.random() < 0.8 else None)

    def _forward_part(self) -> None:
        start, end = self._part()
        self._pass(lambda net: net.forward(start=start, end=end))

    def _slopes(self) -> dict[str, np.ndarray]:
        net = self.nets[0]
        return {name: self.values.normal(size=net.blobs[name].shape) for name in net.outputs}

    def _backward(self) -> None:
        slopes = self._slopes() if self.rng.random() < 0.7 else {}
        self.diffs_known = self._each(lambda net: net.backward(**slopes)) and self.weights_kept

    def _backward_part(self) -> None:
        end, start = self._part()
        if not self.diffs_known:  # gradients of another pass, which may no longer exist in the middle of the net
            start = None
        self._each(lambda net: net.backward(start=start, end=end))

    def _clear(self) -> None:
        for net in self.nets:
            net.clear_param_diffs()

    def _any_blob(self) -> str:
        name = self.rng.choice(list(self.nets[0].blobs))
        self.show(f"    {name}")
        return name

    def _read_data(self) -> None:
        name = self._any_blob()
        self._same(f"data of {name}", [net.blobs[name].data for net in self.nets])

    def _read_diff(self) -> None:
        name = self._any_blob()
        self._same(f"diff of {name}", [net.blobs[name].diff for net in self.nets])

    def _write_data(self) -> None:
        last = self.nets[0].layers[-1].name
        self._pass(lambda net: net.forward(start=last))  # a part: from then on all blobs are stored
        name = self._any_blob()
        value = self.values.normal(size=self._shape(name))
        for net in self.nets:
            net.blobs[name].data[...] = value

    def _write_diff(self) -> None:
        if not self.diffs_known:
            return
        name = self._any_blob()
        value = self.values.normal(size=self._shape(name))
        for net in self.nets:
            for blob in net.blobs.values():  # before one is written, those that are not stored are computed
                blob.diff  # noqa: B018
            net.blobs[name].diff[...] = value

    def _write_parameter(self) -> None:
        self.diffs_known = self.weights_kept = False
        for name, params in self.nets[0].params.items():
            for i, param in enumerate(params):
                value = self.values.normal(size=param.shape)
                for net in self.nets:
                    net.params[name][i].data[...] = value

    def _share(self) -> None:
        self.diffs_known = self.weights_kept = False
        for net, other in zip(self.nets, self.others()):
            if net.params:
                net.share_params(other)

    def _forward_reshape_backward(self) -> None:
        self._forward()
        if self.ended:
            return
        count = self.rng.randint(1, 5)
        inputs = self.nets[0].inputs
        for name in inputs if self.rng.random() < 0.6 else [self.rng.choice(inputs)]:
            for net in self.nets:
                net.blobs[name].reshape(count, *net.blobs[name].shape[1:])
        self._pass(lambda net: net.reshape())
        if not self.ended:
            self._backward()


def check(seed: int, show: Callable[[str], object] = lambda line: None) -> None:
    """Run the program of a seed; every second one in slices of two items, so that there are several."""
    before, pool = slices.MAX_SLICE, parallel._helpers
    slices.MAX_SLICE = 2 if seed % 2 else before
    try:
        Program(seed, show).run()
    finally:
        slices.MAX_SLICE = before
        parallel._helpers = pool


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("block", range(3))
def test_the_engines_agree(block: int, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("ERROR", "netlib")
    for seed in range(block * PER_TEST, (block + 1) * PER_TEST):
        try:
            check(seed)
        except AssertionError as error:
            pytest.fail(f"program {seed}: {error}")


if __name__ == "__main__":
    logging.getLogger("netlib").setLevel(logging.ERROR)  # in-place layers that overwrite values needed by a gradient
    check(int(sys.argv[1]), print)
