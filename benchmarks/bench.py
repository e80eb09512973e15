#!/usr/bin/env python3
"""Benchmark against PyTorch, onnxruntime and OpenCV, with the same network and weights, in one run.

    make bench                                  or: python benchmarks/bench.py --json speed.json

The outputs of every peer, and PyTorch's gradients, are first compared with this project's; nothing is timed unless they
agree. Each pair is then timed alternately, A B A B ..., and the median times and the median ratio are printed. A timing
is a burst of calls after one warm-up call, so that each implementation runs with its own caches and threads. Depth
images are synthetic hands. Run it on an idle machine; it warns if the machine is busy. Without the packages of the
peers, --alone times only this project.

The ratios are compared with those stored for the same kind of machine (benchmarks/results), and rows that are slower by
more than their noise are listed. Two machines of a kind differ, so this is a note; with --check the exit status is then
1. With --store, or if there are none yet, the ratios are stored.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import tools

tools.begin(__name__)

import cv2
import numpy as np

import netlib
from benchmarks import stored
from benchmarks.paper import WEIGHTS, Paper, add_timing, small
from export.onnx.net import onnx_image
from layers.hand.skeleton import load
from netlib.errors import NetlibError
from netlib.net import Net
from tools.common.arguments import parser_of
from tools.common.console import DONE, FAILED, guarded

try:
    import onnxruntime
    import torch

    from benchmarks.peers import TorchHand, TorchHandByJoint, TorchNet
except ModuleNotFoundError as error:
    MISSING: str | None = error.name
else:
    MISSING = None

FLOPS_FORWARD = 2 * (
    124**2 * 8 * 25 + 27**2 * 8 * 200 + 12**2 * 8 * 72 + 1152 * 1024 + 1024**2 + 1024 * 47
)  # per image
FLOPS_TRAINING = 3 * FLOPS_FORWARD - 2 * 124**2 * 8 * 25  # the first convolution needs no gradient of its input
Job = Callable[[], Any]


def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; returns the exit status."""
    parser = parser_of(__doc__)
    add_timing(parser, rounds=15, burst=0.2)
    only = parser.add_mutually_exclusive_group()
    only.add_argument("--alone", action="store_true", help="time only this project, without peers")
    only.add_argument("--check", action="store_true", help="exit with status 1 if a ratio is below the stored one")
    only.add_argument("--store", action="store_true", help="replace the stored ratios")
    parser.add_argument("--json", metavar="FILE", help="also write the results as JSON")
    return guarded(run, parser.parse_args(argv))


def run(args: argparse.Namespace) -> int:
    """Run all comparisons. Raises NetlibError if a package of the peers is missing, or if --check has no ratios."""
    if MISSING and not args.alone:
        raise NetlibError(f"{MISSING} is missing: pip install -e '.[bench]', or use --alone to time only this project")
    kind = stored.kind(args.threads)
    if args.check and stored.load(stored.path_of(kind)) is None:
        raise NetlibError(f"no ratios are stored for {kind}: run without --check first")
    set_threads(args.threads, args.alone)
    load = os.getloadavg()[0]
    if load > 0.5:
        print(f"warning: the machine is busy (load {load:.1f}); timings will vary", file=sys.stderr)
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder), args)
        if not args.alone:
            bench.check()
        bench.run()
    print(bench.table())
    peers = () if args.alone else (torch, onnxruntime, cv2)
    versions = {peer.__name__: peer.__version__ for peer in (np, *peers)}
    facts = {"kind": kind, "date": date.today().isoformat(), "load": load, **versions}
    if args.json:
        Path(args.json).write_text(json.dumps({**facts, "rows": bench.rows}, indent=2), encoding="utf-8")
    return DONE if args.alone else compare_with_stored(facts, bench.rows, store=args.store, check=args.check)


def compare_with_stored(
    facts: dict[str, Any], rows: list[stored.Row], *, store: bool = False, check: bool = False
) -> int:
    """Print which rows are slower than the stored ones; store the ratios if requested or if there are none.

    Only ``store`` and ``check`` fail: a store that cannot be read or written does not invalidate the measurements.
    """
    path = stored.path_of(facts["kind"])
    try:
        before = None if store else stored.load(path)
        if before is None:
            stored.save(path, facts, rows)
            print(f"stored in {path}")
            return DONE
    except (NetlibError, OSError) as error:
        if store or check:
            raise
        print(f"ratios not compared or stored: {error}", file=sys.stderr)
        return DONE
    lines = stored.slower(rows, before["rows"])
    reference = f"than on {before['date']}, on {before['kind']}"
    print("\n".join([f"slower {reference}:", *lines]) if lines else f"nothing is slower {reference}")
    return FAILED if lines and check else DONE


def set_threads(count: int, alone: bool) -> None:
    """Set the number of threads of every library."""
    netlib.set_threads(count)
    if not alone:
        torch.set_num_threads(count)
        cv2.setNumThreads(count)


class Bench:
    """The data, nets and results of the benchmark."""

    def __init__(self, folder: Path, args: argparse.Namespace) -> None:
        self.folder, self.rounds, self.threads, self.burst = folder, args.rounds, args.threads, args.burst
        self.alone = args.alone
        self.large, self.small = args.batch, small(args.batch)
        self.rows: list[dict[str, Any]] = []
        self.paper = Paper(folder, self.large, self.threads)
        self.depth, self.joint = self.paper.depth, self.paper.joint
        self.solver, self.deploy = self.paper.solver, self.paper.deploy
        self.skeleton = load()

    # ------------------------------------------------------------------------------------------ agreement

    def check(self) -> None:
        """Compare outputs and gradients with the peers'. Raises NetlibError if they differ."""
        x = self.depth[:8]
        net = self.deploy(len(x))
        joints = net.forward(depth=x)["pred"].copy()
        angles = net.blobs["DoF"].data.copy()
        peer = TorchNet(net, self.skeleton).eval()
        with torch.inference_mode():
            self._check("PyTorch joints", joints, peer(torch.from_numpy(x)).numpy())
        session = self._session(net, len(x), 1)
        self._check("onnxruntime angles", angles, session.run(None, {"depth": x})[0])
        self._check("OpenCV angles", angles, self._opencv(net)(x))
        train = self.solver(self.small)
        train.net.copy_from(net)
        for layer in train.net.layers:
            if layer.type == "Dropout":
                layer.active = False
        loss = train.net.run_forward()
        train.net.clear_param_diffs()
        train.net.run_backward()
        peer = TorchNet(net, self.skeleton).eval()
        depth, joint = (torch.from_numpy(train.net.blobs[n].data.copy()) for n in ("depth", "joint"))
        value = peer.loss(depth, joint)
        value.backward()
        self._check("PyTorch loss", np.array(loss), np.array(value.item()))
        for name, layer in zip(WEIGHTS, peer.trained):
            self._check(f"PyTorch gradient of {name}", train.net.params[name][0].diff, layer.weight.grad.numpy())
            self._check(f"PyTorch gradient of {name}'s bias", train.net.params[name][1].diff, layer.bias.grad.numpy())

    def _check(self, what: str, found: np.ndarray, expected: np.ndarray) -> None:
        error = float(np.abs(found - expected).max() / np.abs(expected).max())
        if not error < 1e-3:
            sys.exit(f"{what}: relative difference {error:.2g}, expected below 1e-3; nothing was timed")

    def _opencv(self, net: Net) -> Callable[[np.ndarray], np.ndarray]:
        path = self.folder / "net.onnx"
        path.write_bytes(self._onnx(net))
        peer = cv2.dnn.readNetFromONNX(str(path))

        def run(x: np.ndarray) -> np.ndarray:
            peer.setInput(x)
            return peer.forward()

        return run

    # ------------------------------------------------------------------------------------------ timing

    def compare(self, what: str, job: Job, peers: dict[str, Job], goals: tuple[float, ...]) -> float:
        """Time a job alternately with each peer and add a row per peer. Returns the job's median time in s."""
        jobs = {"ours": job, **peers}
        times: dict[str, list[float]] = {name: [] for name in jobs}
        calls = {name: self._calls(job) for name, job in jobs.items()}
        for _ in range(self.rounds):
            for name, job in jobs.items():
                job()
                begin = time.perf_counter()
                for _ in range(calls[name]):
                    job()
                times[name].append((time.perf_counter() - begin) / calls[name])
        if not peers:
            self.figure(what, float(np.median(times["ours"])) * 1e3, "ms", "")
        for (name, job_times), goal in zip([(n, times[n]) for n in peers], goals):
            ratios = np.array(job_times) / np.array(times["ours"])
            low, ratio, high = (float(q) for q in np.quantile(ratios, (0.25, 0.5, 0.75)))
            self.rows.append(
                {
                    "what": what,
                    "peer": name,
                    "netlib_ms": float(np.median(times["ours"])) * 1e3,
                    "peer_ms": float(np.median(job_times)) * 1e3,
                    "ratio": ratio,
                    "noise": (high - low) / ratio,
                    "goal": goal,
                }
            )
        return float(np.median(times["ours"]))

    def _calls(self, job: Job) -> int:
        """Return the number of calls in a burst."""
        job()
        begin = time.perf_counter()
        job()
        return max(1, round(self.burst / (time.perf_counter() - begin)))

    def figure(self, what: str, value: float, unit: str, goal: str) -> None:
        """Add a row without a peer."""
        self.rows.append({"what": what, "value": value, "unit": unit, "goal": goal})

    def run(self) -> None:
        """Time everything and add all rows."""
        step = {batch: self.training(batch) for batch in (self.large, self.small)}
        forward = self.forward_large()
        self.forward_small()
        self.one_image()
        self.hand()
        peak = self.sgemm_peak()
        self.figure("sgemm peak", peak / 1e9, "GFLOP/s", "")
        training = 100 * self.large * FLOPS_TRAINING / step[self.large] / peak
        self.figure("fraction of peak, training", training, "%", ">= 38")
        self.figure("fraction of peak, forward", 100 * self.large * FLOPS_FORWARD / forward / peak, "%", ">= 48")
        parts = self.large // self.small
        ratio = step[self.large] / (parts * step[self.small])
        self.figure(f"time of {self.large} against {parts} x {self.small}", ratio, "x", "0.9 to 1.1")
        self.figure("data, log and overhead", self.overhead(), "% of a step", "< 5")
        self.figure(f"peak memory, training at {self.large}", self.memory(), "MB", "< 1500, 500")

    def training(self, batch: int) -> float:
        """Compare solver.step(1) with PyTorch's training step."""
        solver = self.solver(batch)
        jobs: dict[str, Job] = {}
        if not self.alone:
            depth, joint = torch.from_numpy(self.depth[:batch]), torch.from_numpy(self.joint[:batch])
            for name, form in self._formats():
                jobs[name] = self._torch_step(TorchNet(solver.net, self.skeleton).train(), depth, joint, form)
        goals = (5.0, 2.8) if batch == self.large else (0.0, 2.6)
        return self.compare(f"training step, batch {batch}", lambda: solver.step(1), jobs, goals)

    @staticmethod
    def _formats() -> tuple[tuple[str, Any], ...]:
        return ("PyTorch eager", torch.contiguous_format), ("PyTorch channels_last", torch.channels_last)

    def _torch_step(self, peer: TorchNet, depth: torch.Tensor, joint: torch.Tensor, form: Any) -> Job:
        peer.conv.to(memory_format=form)
        depth = depth.to(memory_format=form)
        optimiser = torch.optim.SGD(peer.parameters(), lr=0.003, momentum=0.9)

        def job() -> None:
            optimiser.zero_grad(set_to_none=True)
            peer.loss(depth, joint).backward()
            optimiser.step()

        return job

    def forward_large(self) -> float:
        """Compare net.forward with onnxruntime."""
        net = self.deploy(self.large)
        x = self.depth[: self.large]
        jobs: dict[str, Job] = {}
        if not self.alone:
            session = self._session(net, self.large, self.threads)
            jobs["onnxruntime (no hand)"] = lambda: session.run(None, {"depth": x})
        return self.compare(f"forward, batch {self.large}", lambda: net.forward(depth=x), jobs, (1.2,))

    def forward_small(self) -> None:
        """Compare net.forward with OpenCV's dnn."""
        net = self.deploy(self.small)
        x = self.depth[: self.small]
        jobs: dict[str, Job] = {}
        if not self.alone:
            peer = self._opencv(net)
            jobs["OpenCV dnn (no hand)"] = lambda: peer(x)
        self.compare(f"forward, batch {self.small}", lambda: net.forward(depth=x), jobs, (2.0,))

    def one_image(self) -> None:
        """Compare one image on one thread: with the hand to PyTorch, without it to onnxruntime."""
        set_threads(1, self.alone)
        net, bare = self.deploy(1), self._without_hand()
        x = self.depth[:1]
        whole: dict[str, Job] = {}
        angles: dict[str, Job] = {}
        if not self.alone:
            for name, form in self._formats():
                whole[name] = self._torch_forward(TorchNet(net, self.skeleton).eval(), torch.from_numpy(x), form)
            session = self._session(net, 1, 1)
            angles["onnxruntime"] = lambda: session.run(None, {"depth": x})
        self.compare("one image with the hand, 1 thread", lambda: net.forward(depth=x), whole, (2.6, 1.9))
        self.compare("one image without the hand, 1 thread", lambda: bare.forward(depth=x), angles, (0.73,))
        set_threads(self.threads, self.alone)

    def _torch_forward(self, peer: TorchNet, x: torch.Tensor, form: Any) -> Job:
        peer.conv.to(memory_format=form)
        x = x.to(memory_format=form)

        def job() -> None:
            with torch.inference_mode():
                peer(x)

        return job

    def _without_hand(self, engine: str | None = None) -> Net:
        text = (ROOT / "prototxt" / "nyu_deploy.prototxt").read_text()
        (self.folder / "bare.prototxt").write_text(text[: text.index("# Joint angles")])
        return Net(self.folder / "bare.prototxt", netlib.TEST, seed=1, engine=engine)

    def _onnx(self, net: Net) -> bytes:
        """Export the network up to the angles, with a net's weights, as ONNX."""
        bare = self._without_hand("plain")
        bare.copy_from(net)
        return onnx_image(bare)

    def _session(self, net: Net, batch: int, threads: int) -> Any:
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.add_free_dimension_override_by_name("N", batch)
        return onnxruntime.InferenceSession(self._onnx(net), options, providers=["CPUExecutionProvider"])

    def hand(self) -> None:
        """Compare HandModel forward and backward with autograd."""
        x = np.random.default_rng(0).normal(0, 0.3, (self.large, 47)).astype(np.float32)
        dy = np.random.default_rng(1).normal(size=(self.large, 93)).astype(np.float32)
        text = f"""force_backward: true
            layer {{ name: "i" type: "Input" top: "x" input_param {{ shape {{ dim: {self.large} dim: 47 }} }} }}
            layer {{ name: "h" type: "HandModel" bottom: "x" top: "y" }}"""
        (self.folder / "hand.prototxt").write_text(text)
        net = Net(self.folder / "hand.prototxt", netlib.TRAIN)

        def job() -> None:
            net.forward(x=x)
            net.backward(y=dy)

        job()
        jobs = {} if self.alone else self._torch_hands(x, dy, net.blobs["x"].diff)
        self.compare(f"HandModel forward + backward, {self.large}", job, jobs, (11.0, 0.0))

    def _torch_hands(self, x: np.ndarray, dy: np.ndarray, dx: np.ndarray) -> dict[str, Job]:
        """Return jobs for two implementations of the hand, after checking their gradients."""
        tensor, gradient = torch.from_numpy(x), torch.from_numpy(dy)

        def job_of(peer: torch.nn.Module) -> Job:
            def job() -> np.ndarray:
                tensor.grad = None
                tensor.requires_grad_(True)
                peer(tensor).backward(gradient)
                return tensor.grad.numpy()

            self._check("PyTorch gradient of the hand", dx, job())
            return job

        hands = {"PyTorch, joint by joint": TorchHandByJoint, "PyTorch, by depth": TorchHand}
        return {name: job_of(hand(self.skeleton)) for name, hand in hands.items()}

    def sgemm_peak(self) -> float:
        """Measure FLOP/s of large matrix products, one per thread."""
        n = 1536
        a = [np.random.default_rng(i).random((n, n), dtype=np.float32) for i in range(self.threads)]
        best = 0.0
        for _ in range(self.rounds):
            workers = [threading.Thread(target=np.matmul, args=(m, m)) for m in a]
            begin = time.perf_counter()
            for worker in workers:
                worker.start()
            for worker in workers:
                worker.join()
            best = max(best, 2 * n**3 * self.threads / (time.perf_counter() - begin))
        return best

    def overhead(self) -> float:
        """Return the overhead of solver.step over the net's passes, without its data, and the update, in percent."""
        solver = self.solver(self.large)
        net = solver.net
        solver.step(2)
        seconds: Counter[str] = Counter()

        def timed(owner: Any, method: str, sign: int = 1) -> None:
            call = getattr(owner, method)

            def job(*args: Any, **options: Any) -> Any:
                begin = time.perf_counter()
                found = call(*args, **options)
                seconds["bare"] += sign * (time.perf_counter() - begin)
                return found

            setattr(owner, method, job)

        # The data layer, whose time is not that of the net.
        timed(net.steps[0], "forward", -1)
        for owner, method in ((net, "clear_param_diffs"), (net, "run_forward"), (net, "run_backward"),
                              (solver, "apply_update")):
            timed(owner, method)
        whole, bare = [], []
        for _ in range(self.rounds):
            seconds.clear()
            begin = time.perf_counter()
            solver.step(1)
            whole.append(time.perf_counter() - begin)
            bare.append(seconds["bare"])
        return 100 * (float(np.median(whole)) / float(np.median(bare)) - 1)

    def memory(self) -> float:
        """Return the peak memory of a process that trains with the large batch, in MB."""
        self.solver(self.large)
        code = (f"import sys; sys.path.insert(0, {str(ROOT)!r}); import netlib; "
                f"netlib.set_threads({self.threads}); "
                f"netlib.get_solver({str(self.folder / 'solver.prototxt')!r}).step(4); "
                "print(open('/proc/self/status').read().split('VmHWM:')[1].split()[0])")
        done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
        return int(done.stdout) * 1024 / 1e6

    # ------------------------------------------------------------------------------------------ the table

    def table(self) -> str:
        """Format all rows."""
        lines = [f"{netlib.BLAS_NOTE}; {self.threads} threads; medians of interleaved bursts"]
        for row in self.rows:
            if "ratio" in row:
                goal = f"goal {row['goal']:.2f}" if row["goal"] else ""
                lines.append(f"{row['what']:<38}{row['netlib_ms']:9.2f} ms  {row['peer']:<24}{row['peer_ms']:9.2f} ms "
                             f"{row['ratio']:6.2f}x  {goal}")
            else:
                goal = f"goal {row['goal']}" if row["goal"] else ""
                lines.append(f"{row['what']:<38}{row['value']:9.2f} {row['unit']}  {goal}")
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        lines.append(f"(this process, peers included: {peak:.0f} MiB)")
        return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
