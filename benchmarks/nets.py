#!/usr/bin/env python3
"""Benchmark of ordinary nets: the forward pass of nine, a training step of four small ones.

    make bench                                  or: python benchmarks/nets.py --threads 1 --cpu

Forward passes are compared with OpenCV (its Caffe importer if it has one, else the net exported to ONNX), onnxruntime
and PyTorch, training steps with PyTorch in both memory layouts. Outputs and gradients are compared first, and a peer
that differs is not timed. Each pair is timed alternately; the medians are printed with the peer's time divided by ours,
so a ratio above 1 means that this project is faster. A package that is not installed is left out.

On a busy machine use --cpu, which measures the processor time of the process instead of the time, and one thread.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import tools

tools.begin(__name__)

import cv2
import numpy as np

import netlib
from benchmarks.ordinary_nets import NETS, Ordinary, fill
from netlib.net import Net
from tools.common.arguments import parser_of, positive
from tools.common.console import DONE, guarded

Job = Callable[[], Any]
TOLERANCE = 1e-3  # of the largest value
OF_GRADIENTS = 2e-2  # where the input of a ReLU is zero up to rounding, either gradient is right
PACKAGES = {"torch": "PyTorch", "onnxruntime": "onnxruntime", "onnx": "OpenCV through ONNX, and onnxruntime"}


def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; returns the exit status."""
    parser = parser_of(__doc__)
    parser.add_argument("--rounds", type=positive, default=7, help="number of timings (default: %(default)s)")
    parser.add_argument("--threads", type=positive, default=min(2, netlib.threads()), help="default: %(default)s")
    parser.add_argument("--cpu", action="store_true", help="measure processor time, for a busy machine")
    names = [one.name for one in NETS]
    parser.add_argument("--nets", nargs="+", choices=names, default=names, metavar="NAME", help=", ".join(names))
    parser.add_argument("--json", metavar="FILE", help="also write the results as JSON")
    return guarded(run, parser.parse_args(argv))


def run(args: argparse.Namespace) -> int:
    """Time the nets and print a line for each peer."""
    netlib.set_threads(args.threads)
    cv2.setNumThreads(args.threads)
    load = os.getloadavg()[0]
    if load > 0.5 and not args.cpu:
        print(f"warning: the machine is busy (load {load:.1f}); timings will vary", file=sys.stderr)
    unit = "processor time" if args.cpu else "time"
    print(f"{netlib.BLAS_NOTE}; {args.threads} threads; medians of the {unit}, load {load:.1f}")
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        for one in NETS:
            if one.name in args.nets:
                peers = Training(Path(folder), one) if one.trains else Forward(Path(folder), one)
                rows += compare(peers, args)
    if args.json:
        Path(args.json).write_text(json.dumps({"threads": args.threads, "load": load, "rows": rows}, indent=1), "utf-8")
    return DONE


def compare(peers: Forward | Training, args: argparse.Namespace) -> list[dict[str, Any]]:
    """Time a net alternately with its peers, and print and return a row for each."""
    jobs = {"ours": peers.job, **peers.peers(args.threads)}
    clock = time.process_time if args.cpu else time.perf_counter
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for number in range(args.rounds + 1):  # the first is not counted
        for name, job in jobs.items():
            begin = clock()
            job()
            if number:
                times[name].append(clock() - begin)
    own = float(np.median(times.pop("ours")))
    rows = [{"what": peers.what, "netlib_ms": 1e3 * own}] if not times else []
    for name, found in times.items():
        theirs = float(np.median(found))
        rows.append({"what": peers.what, "peer": name, "netlib_ms": 1e3 * own, "peer_ms": 1e3 * theirs,
                     "ratio": theirs / own})
    for row in rows:
        line = f"{row['what']:<30}{row['netlib_ms']:9.2f} ms"
        print(line if "peer" not in row else f"{line}  {row['peer']:<32}{row['peer_ms']:9.2f} ms {row['ratio']:6.2f}x",
              flush=True)
    return rows


def agrees(what: str, found: np.ndarray, expected: np.ndarray, tolerance: float = TOLERANCE) -> bool:
    """Whether a peer's values are ours; if not, print a note: it is not timed."""
    error = float(np.abs(found.reshape(-1) - expected.reshape(-1)).max() / max(np.abs(expected).max(), 1e-30))
    if error < tolerance:
        return True
    print(f"{what} is not timed: its values differ by {error:.2g} of the largest, not below {tolerance:g}",
          file=sys.stderr)
    return False


class Forward:
    """The forward pass of a net on its batch."""

    def __init__(self, folder: Path, one: Ordinary) -> None:
        self.folder, self.name, self.path = folder, one.name, folder / f"{one.name}.prototxt"
        self.path.write_text("\n".join(one.text().lines), encoding="utf-8")
        self.net = Net(self.path, netlib.TEST, seed=1)
        fill(self.net, np.random.default_rng(1))
        self.x = np.random.default_rng(0).normal(size=self.net.blobs["data"].shape).astype(np.float32)
        self.what = f"forward {one.name}, batch {len(self.x)}"
        (self.output,) = self.net.forward(data=self.x)

    def job(self) -> np.ndarray:
        """One forward pass."""
        return self.net.forward(data=self.x)[self.output]

    def peers(self, threads: int) -> dict[str, Job]:
        """The peers that are installed and give the same output."""
        makers = {f"OpenCV {cv2.__version__}": self._opencv, "onnxruntime": self._onnxruntime, "PyTorch": self._torch}
        jobs: dict[str, Job] = {}
        expected = self.job().copy()
        for name, make in makers.items():
            try:
                job = make(threads)
                found = job()
            except ModuleNotFoundError as error:
                note(error)
                continue
            if agrees(f"{name}, {self.what}", np.asarray(found), expected):
                jobs[name] = job
        return jobs

    def _opencv(self, threads: int) -> Job:
        if hasattr(cv2.dnn, "readNetFromCaffe"):
            self.net.save(self.folder / f"{self.name}.caffemodel")
            peer = cv2.dnn.readNetFromCaffe(str(self.path), str(self.folder / f"{self.name}.caffemodel"))
        else:
            (self.folder / "net.onnx").write_bytes(self._onnx())
            peer = cv2.dnn.readNetFromONNX(str(self.folder / "net.onnx"))

        def run() -> np.ndarray:
            peer.setInput(self.x)
            return peer.forward()

        return run

    def _onnx(self) -> bytes:
        import onnx  # noqa: F401  (a missing package is a note here, an error in the export)

        from export.onnx.net import onnx_image

        plain = Net(self.path, netlib.TEST, engine="plain")  # the plain layers store their options by name
        plain.copy_from(self.net)
        return onnx_image(plain)

    def _onnxruntime(self, threads: int) -> Job:
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.add_free_dimension_override_by_name("N", len(self.x))
        session = onnxruntime.InferenceSession(self._onnx(), options, providers=["CPUExecutionProvider"])
        return lambda: session.run(None, {"data": self.x})[0]

    def _torch(self, threads: int) -> Job:
        import torch

        from benchmarks.torch_graph import TorchGraph

        torch.set_num_threads(threads)
        graph, x = TorchGraph(self.net).eval(), torch.from_numpy(self.x)

        def run() -> np.ndarray:
            with torch.inference_mode():
                return graph(data=x).numpy()

        return run


class Training:
    """A training step of a net: both passes and SGD with momentum."""

    def __init__(self, folder: Path, one: Ordinary) -> None:
        path, solver = folder / f"{one.name}.prototxt", folder / "solver.prototxt"
        path.write_text("\n".join(one.text().lines), encoding="utf-8")
        solver.write_text(f'net: "{path}" base_lr: 0.0001 momentum: 0.9 lr_policy: "fixed" random_seed: 1')
        self.solver = netlib.get_solver(solver)
        net, rng = self.solver.net, np.random.default_rng(0)
        self.x = rng.normal(size=net.blobs["data"].shape).astype(np.float32)
        self.labels = rng.integers(0, 10, len(self.x))
        net.blobs["data"].data[...], net.blobs["label"].data[...] = self.x, self.labels
        self.what = f"training {one.name}, batch {len(self.x)}"

    def job(self) -> None:
        """One training step."""
        self.solver.step(1)

    def peers(self, threads: int) -> dict[str, Job]:
        """PyTorch in both memory layouts, if it is installed and gives the same gradients."""
        try:
            import torch

            from benchmarks.torch_graph import TorchGraph
        except ModuleNotFoundError as error:
            note(error)
            return {}
        torch.set_num_threads(threads)
        net = self.solver.net
        net.clear_param_diffs()
        net.run_forward()
        net.run_backward()
        jobs: dict[str, Job] = {}
        for name, layout in (("eager", torch.contiguous_format), ("channels_last", torch.channels_last)):
            graph = TorchGraph(net).train().to(memory_format=layout)
            x, labels = torch.from_numpy(self.x).to(memory_format=layout), torch.from_numpy(self.labels)
            optimiser = torch.optim.SGD(graph.parameters(), lr=0.0001, momentum=0.9)

            def step(graph: Any = graph, x: Any = x, labels: Any = labels, optimiser: Any = optimiser) -> None:
                optimiser.zero_grad(set_to_none=True)
                graph(data=x, label=labels).backward()
                optimiser.step()

            graph(data=x, label=labels).backward()
            pairs = [(key, param.grad.numpy(), net.params[key[0]][key[1]].diff) for key, param in graph.pairs.items()]
            if all(agrees(f"PyTorch {name}, {self.what}, gradient {key}", *pair, OF_GRADIENTS) for key, *pair in pairs):
                jobs[f"PyTorch {name}"] = step
        return jobs


_noted: set[str] = set()


def note(error: ModuleNotFoundError) -> None:
    """Print once that a package is missing."""
    name = str(error.name)
    if name not in _noted:
        _noted.add(name)
        print(f"without {PACKAGES.get(name, name)}: pip install -e '.[bench]'", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
