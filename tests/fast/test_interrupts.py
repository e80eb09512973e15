"""After a KeyboardInterrupt at any line of a net's code, the next pass and all looks are right."""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import FrameType
from typing import Any

import numpy as np
import pytest

import netlib
from netlib.files.paths import ROOT
from netlib.proto import prototxt
from tests.support.nets import inputs

FOLDERS = tuple(str(ROOT / name) for name in ("netlib", "fast", "layers"))
FILLER = 'weight_filler { type: "gaussian" std: 0.5 }'
TEXT = (
    "force_backward: true "
    + inputs(x=(5, 2, 9, 9), z=(3, 2, 9, 9))
    + f"""
    layer {{ name: "c" type: "Convolution" bottom: "x" top: "c"
            convolution_param {{ num_output: 6 kernel_size: 3 {FILLER} }} }}
    layer {{ name: "r" type: "ReLU" bottom: "c" top: "c" }}
    layer {{ name: "p" type: "Pooling" bottom: "c" top: "p" pooling_param {{ kernel_size: 2 stride: 2 }} }}
    layer {{ name: "n" type: "BatchNorm" bottom: "p" top: "n" }}
    layer {{ name: "s" type: "Scale" bottom: "n" top: "n"
            scale_param {{ bias_term: true filler {{ value: 3 }} }} }}
    layer {{ name: "l" type: "Reduction" bottom: "n" top: "l" loss_weight: 1
            reduction_param {{ operation: SUMSQ }} }}
    layer {{ name: "q" type: "Convolution" bottom: "z" top: "q"
            convolution_param {{ num_output: 2 kernel_size: 3 {FILLER} }} }}
    layer {{ name: "t" type: "Convolution" bottom: "q" top: "t"
            convolution_param {{ num_output: 2 kernel_size: 1 {FILLER} }} }}
    layer {{ name: "m" type: "Reduction" bottom: "t" top: "m" loss_weight: 1
            reduction_param {{ operation: SUMSQ }} }}"""
)
RNG = np.random.default_rng(0)
FIRST, SECOND = (
    {"x": RNG.normal(size=(count, 2, 9, 9)), "z": RNG.normal(size=(8 - count, 2, 9, 9))}
    for count in (5, 4)
)
OPERATIONS: dict[str, Callable[[netlib.Net], object]] = {
    "forward": lambda net: net.forward(**FIRST),
    "a new shape": lambda net: net.forward(**SECOND),
    "backward": lambda net: net.backward(),
    "a look": lambda net: net.blobs["c"].data,
    "a part": lambda net: net.forward(start="n"),
    "an iteration": lambda net: net.run_forward_backward(),
    "storing less again": lambda net: (net.store_all(), net.store_all(False), net.forward()),
}
STRIDE = 307  # lines between two interrupts: every fifth was tried once


def interrupted(work: Callable[[], object], line: int) -> bool:
    """Raise KeyboardInterrupt at the n-th line of the net's code; returns whether there is one."""
    left = line

    def count(frame: FrameType, event: str, argument: object) -> Any:
        nonlocal left
        left -= event == "line"
        if event == "line" and left == 0:
            raise KeyboardInterrupt
        return count

    def trace(frame: FrameType, event: str, argument: object) -> Any:
        return count if frame.f_code.co_filename.startswith(FOLDERS) else None

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        work()
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(before)
    return False


def run(net: netlib.Net, batch: dict[str, np.ndarray]) -> None:
    net.clear_param_diffs()
    net.forward(**batch)
    net.backward()


@pytest.mark.parametrize("name", OPERATIONS)
def test_passes_after_an_interrupt_at_any_line_are_correct(name: str) -> None:
    model = prototxt.parse(TEXT)
    plain = netlib.Net(model, netlib.TRAIN, engine="plain", seed=1, dtype=np.float64)
    run(plain, SECOND)
    line, was_interrupted = 1, True
    while was_interrupted:
        net = netlib.Net(model, netlib.TRAIN, seed=1, dtype=np.float64)
        run(net, FIRST)
        was_interrupted = interrupted(lambda net=net: OPERATIONS[name](net), line)
        run(net, SECOND)
        for blob in plain.blobs:
            for half in ("data", "diff"):
                found, expected = (getattr(one.blobs[blob], half) for one in (net, plain))
                np.testing.assert_allclose(
                    found, expected, 1e-8, 1e-8, err_msg=f"line {line}: {half} of {blob}"
                )
        line += STRIDE
    assert line > STRIDE
