"""The gain of each part of fast/, measured by switching it off.

    python -m experiments parts        the paper's network and the small nets
    python -m experiments parts --nets SqueezeNet ResNet-50 --parts Winograd fusing

The net is built with and without a part, and both run alternately on one thread. "time" is the
processor time without the part divided by that with it (above 1: the part makes it faster); the
smallest of some rounds is used, so the measurement tolerates a busy machine. "memory" is the same
for the peak size of all NumPy arrays, from building the net to its second run. A part is a fast
layer, an algorithm of fast/convolution.py, or a mechanism that a constant or a function switches;
only parts that can affect the net are listed. "fast engine" is the plain engine in comparison.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import netlib
from experiments.choices import add_choices
from experiments.example_nets import NETS, Example
from experiments.workload import Workload
from netlib.engine import Step
from tools.common.arguments import positive, positive_number
from tools.common.console import aligned

FAST = "fast engine"


class Part(NamedTuple):
    """A part: ``off()`` is a context without it.

    ``place`` is that of the plain layer, if it is a fast layer.
    """

    off: Callable[[], AbstractContextManager[object]]
    place: str = ""


def parts_of_fast() -> dict[str, Part]:
    """All parts by name. Raises ImportError without fast/."""
    from fast import convolution
    from fast.engine import FAST_CLASSES

    parts = {FAST: Part(contextlib.nullcontext)}
    for place in FAST_CLASSES:
        others = {other: name for other, name in FAST_CLASSES.items() if other != place}
        off = functools.partial(mock.patch.dict, FAST_CLASSES, others, clear=True)
        parts[f"fast {_last(place)}"] = Part(off, place)
    *names, general = [_name_of(algorithm) for algorithm in convolution.ALGORITHMS]
    for name in names:
        if name == general:  # without it, no algorithm is left for some sizes
            continue
        kept = tuple(other for other in convolution.ALGORITHMS if _name_of(other) != name)
        off_algorithm = functools.partial(mock.patch.object, convolution, "ALGORITHMS", kept)
        parts[name] = Part(off_algorithm)
    for name, (place, value) in _mechanisms().items():
        parts[name] = Part(functools.partial(mock.patch, place, value))
    return parts


def _mechanisms() -> dict[str, tuple[str, Any]]:
    """The places of constants and functions, and their values without the mechanism."""
    from fast import fusing, plan

    return {
        "slices of the batch": (
            "fast.engine.plan",
            lambda connections, stored: [*map(plan.whole, connections)],
        ),
        "tiles between layers": ("fast.plan._agree_on_tiles", lambda order, unstored: {}),
        "ReLU after the pooling": ("fast.plan._pool_first", lambda row, unstored: list(row)),
        "windows without background": (
            "fast.window_tiles.WindowTiles.fits",
            staticmethod(lambda *sizes: False),
        ),
        "items one at a time": ("fast.inner_product.FEW_ITEMS", 0),
        "blocked products": ("fast.inner_product.MAX_BLOCK", 1 << 30),
        "updates in blocks": ("netlib.updates.BLOCK", 1 << 40),
        "reshape where shapes change": ("fast.whole_steps.WholeStep.forward", Step.forward),
        "fusing": ("fast.engine.fuse", lambda connections, stored: fusing.release(connections)),
        "Winograd for few tiles": ("fast.winograd.FEW_TILES", 0),
        "depthwise by filter2D": ("fast.depthwise.FILTERED", 1 << 40),
        "maxima at every place": ("fast.map_pooling.MAX_EVERYWHERE", 0),
        "single poses": ("fast.kinematics.FEW", 0),
    }


def _last(place: str) -> str:
    return place.rpartition(".")[2]


def _name_of(algorithm: Any) -> str:
    """The class of an algorithm, or of the one that an adapter uses."""
    if hasattr(algorithm, "algorithm"):
        return _name_of(algorithm.algorithm)
    return type(algorithm).__name__


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    default = [name for name, example in NETS.items() if example.trains or name == "hand-1"]
    add_choices(parser, "--nets", NETS, default)
    parts = parts_of_fast() if netlib.engine.has_fast() else {}
    add_choices(parser, "--parts", parts)
    parser.add_argument(
        "--rounds", type=positive, default=5, metavar="N", help="default: %(default)s"
    )
    parser.add_argument(
        "--burst",
        type=positive_number,
        default=0.2,
        metavar="S",
        help="processor time of a round, at least one run (default: %(default)s)",
    )


def run(args: argparse.Namespace) -> None:
    """Measure the selected parts and print a table for each net.

    Raises ImportError without fast/.
    """
    netlib.set_threads(1)
    parts = parts_of_fast()
    for net in args.nets:
        with tempfile.TemporaryDirectory() as folder:
            base = Measured(NETS[net], Path(folder))
            rows = [["switched off", "time", "memory"]]
            for name in args.parts:
                if applies(parts[name], base.work):
                    ratios = base.without(name, parts[name], args.rounds, args.burst)
                    rows.append([name, *(f"{ratio:.2f}" for ratio in ratios)])
            title = f"{net}: {1e3 * base.seconds:.2f} ms, {base.peak / 1e6:.1f} MB"
            print(f"{title}\n{aligned(rows)}\n", flush=True)


def applies(part: Part, work: Workload) -> bool:
    """Whether the net has a layer of the part's type, if it is one of a layer."""
    types = {layer.type for layer in work.net.layers}
    return not part.place or _last(part.place) in types


class Measured:
    """A net with all parts.

    seconds  smallest processor time of a run
    peak     peak size of all arrays in bytes
    """

    def __init__(self, example: Example, folder: Path) -> None:
        self.example, self.folder = example, folder
        self.work = Workload(example, folder, "fast")
        self.seconds = _seconds(self.work, 1)
        self.peak = self._peak_of("fast")

    def without(self, name: str, part: Part, rounds: int, burst: float) -> tuple[float, float]:
        """The processor time and the peak size without a part, divided by those with it."""
        engine = "plain" if name == FAST else "fast"
        with part.off():
            peak = self._peak_of(engine)
            work = Workload(self.example, self.folder, engine)
            work.run()
        calls = max(1, round(burst / self.seconds))
        with_part, without_part = [], []
        for _ in range(rounds):
            with_part.append(_seconds(self.work, calls))
            with part.off():
                without_part.append(_seconds(work, calls))
        self.seconds = min(self.seconds, *with_part)
        return min(without_part) / min(with_part), peak / self.peak

    def _peak_of(self, engine: str) -> int:
        """The peak size in bytes of a further net's arrays, in a new thread, which has no
        working memory yet.
        """
        with ThreadPoolExecutor(1) as pool:
            return pool.submit(self._peak_here, engine).result()

    def _peak_here(self, engine: str) -> int:
        tracemalloc.start()
        try:
            work = Workload(self.example, self.folder, engine)
            work.run()
            work.run()
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()


def _seconds(work: Workload, calls: int) -> float:
    """The mean processor time of a run in s, after one that is not counted."""
    work.run()
    begun = time.process_time()
    for _ in range(calls):
        work.run()
    return (time.process_time() - begun) / calls
