"""At any moment, a first access to any blob gives what the plain engine has there, or an error;
never another value.

``check(123)`` builds a random net under both engines, brings it to a moment of its life, lets a
caller write something, and looks at one half of one blob, then at all others. Errors are allowed
where docs/caffe.md lists them.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from random import Random
from typing import Any

import numpy as np
import pytest

import netlib
from fast import division
from netlib.proto import prototxt
from tests.support.random_nets import images, random_net
from tests.support.sliced_nets import unstored

Array = np.ndarray
Net = netlib.Net
Generator = np.random.Generator
Change = Callable[[Net, Generator], object]
TOLERANCE = 1e-9  # of the largest value of an array, or of 1 where all are smaller


def passes(net: Net, rng: Generator, kinds: str) -> None:
    """Run forwards for each ``f``, backwards for each ``b``; multiply the weights
    for each ``w``.
    """
    for kind in kinds:
        if kind == "f":
            net.forward(**images(net, rng))
        elif kind == "b":
            net.backward(**{name: rng.normal(size=net.blobs[name].shape) for name in net.outputs})
        else:
            for param in net.learnable:
                param.blob.data[...] *= 1.5


def reshape(net: Net, count: int | None, names: int, whole: bool = True) -> None:
    """Reshape some inputs to another number of items, and the net if ``whole``."""
    for name in net.inputs[:names]:
        blob = net.blobs[name]
        blob.reshape(blob.shape[0] if count is None else count, *blob.shape[1:])
    if whole:
        net.reshape()


def run_part(net: Net, rng: Generator) -> None:
    """Run forwards from a layer other than the first one."""
    number = rng.integers(1, len(net.layers))
    net.forward(start=net.layers[number].name)


def after(kinds: str, then: Change = lambda net, rng: None) -> Change:
    """The moment after these passes, and after something else."""

    def change(net: Net, rng: Generator) -> None:
        passes(net, rng, kinds)
        then(net, rng)

    return change


MOMENTS = {
    "new": after(""),
    "forward": after("f"),
    "backward": after("fb"),
    "two backwards": after("fbb"),
    "a second forward": after("fbf"),
    "a second backward": after("fbfb"),
    "new weights": after("fbw"),
    "new weights before backward": after("fwb"),
    "the same shape again": after("fb", lambda net, rng: reshape(net, None, 9)),
    "fewer items": after("fb", lambda net, rng: reshape(net, 2, 9)),
    "fewer items of one input": after("fb", lambda net, rng: reshape(net, 2, 1)),
    "fewer items in the blob alone": after("fb", lambda net, rng: reshape(net, 2, 1, whole=False)),
    "a part": after("fb", run_part),
}


def write(net: Net, what: str) -> None:
    """Write some of the net's stored values, as a caller can."""
    if what == "a shape":
        for name in net.inputs[:1]:
            net.blobs[name].reshape(1, *net.blobs[name].shape[1:])
    for array in targets(net, what):
        array[...] = array * 0.5 + 1


def targets(net: Net, what: str) -> list[Array]:
    """The arrays that ``what`` names."""
    if what == "a parameter":
        return [param.blob.data for param in net.learnable]
    half, _, kind = what.partition(" of an ")
    names = {"input": net.inputs, "output": net.outputs}.get(kind, [])
    return [getattr(net.blobs[name], half) for name in names]


ARRAYS = ("data of an input", "data of an output", "diff of an input", "diff of an output")
WRITTEN = ("nothing", *ARRAYS, "a parameter", "a shape")


def look(net: Net, name: str, half: str) -> Any:
    try:
        return getattr(net.blobs[name], half).copy()
    except netlib.NetlibError as error:
        return error


def check_look(
    plain: Net, fast: Net, name: str, half: str, where: str, may_fail: bool = False
) -> None:
    """Assert that a look gives the value of the plain engine, or an allowed error."""
    where = f"{where}; {half} of {name}"
    found, expected = (look(net, name, half) for net in (fast, plain))
    errors = [one for one in (found, expected) if isinstance(one, netlib.NetlibError)]
    if errors:
        assert may_fail, f"{where}: {errors}"
        return
    size = abs(expected[np.isfinite(expected)]).max(initial=1)
    np.testing.assert_allclose(found, expected, 0, TOLERANCE * size, equal_nan=True, err_msg=where)


def check(seed: int) -> None:
    """Look at a random blob of a random net at a random moment."""
    division.MAX_SLICE, rng = 2 if seed % 2 else 64, Random(seed)
    model, phase = (
        prototxt.parse(random_net(rng)),
        rng.choice([netlib.TRAIN, netlib.TRAIN, netlib.TEST]),
    )
    plain, fast = (
        Net(model, phase, dtype=np.float64, seed=1, engine=engine) for engine in ("plain", "fast")
    )
    turn, moment = divmod(seed, len(MOMENTS))
    turn, what = divmod(turn, len(WRITTEN))
    moment, what, half = list(MOMENTS)[moment], WRITTEN[what], ("data", "diff")[turn % 2]
    for net in (plain, fast):
        try:
            MOMENTS[moment](net, np.random.default_rng(seed))
        except netlib.LayerError:  # the new shapes do not fit together
            return
        write(net, what)
    left_out = unstored(fast)
    names = [name for name in fast.blobs if (name in left_out) == (turn % 4 < 2)]
    first = rng.choice(names or list(fast.blobs))
    everything = [*product(fast.blobs, ("data", "diff"))]
    is_alone = "alone" in moment or what == "a shape"
    for name, side in [(first, half), *everything]:
        is_copy = "_split_" in name
        if is_copy and side == "data" and what == "data of an input":
            continue  # a copy shares the memory, as in Caffe, or is apart until a part runs
        may_fail = (side == "diff" and moment == "a second forward") or (is_copy and is_alone)
        where = f"seed {seed}, {moment}, written: {what}"
        check_look(plain, fast, name, side, where, may_fail)
    if not is_alone:  # the nets go on
        for net in (plain, fast):
            net.clear_param_diffs()
            passes(net, np.random.default_rng([seed, 1]), "fb")
        for name, side in everything:
            check_look(plain, fast, name, side, f"seed {seed}, later")


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("moment", MOMENTS)
def test_first_accesses_at_any_moment_agree_with_the_plain_engine(
    moment: str, monkeypatch: Any, caplog: Any
) -> None:
    caplog.set_level("ERROR", "netlib")
    monkeypatch.setattr(division, "MAX_SLICE", 64)  # restored after the test
    first = list(MOMENTS).index(moment)
    for seed in range(first, first + 4 * len(MOMENTS) * len(WRITTEN), 3 * len(MOMENTS)):
        check(seed)
