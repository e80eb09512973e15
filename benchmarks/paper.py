"""The paper's network on synthetic hands, and options shared by its benchmarks."""

from __future__ import annotations

import argparse
from pathlib import Path

import h5py
import numpy as np

import netlib
from netlib.files.paths import ROOT
from netlib.net import Net
from netlib.solver import Solver
from tools.common.arguments import positive, positive_number

WEIGHTS = ("convL1", "convL2", "convL3", "FC1", "FC2", "DoF")


def add_timing(parser: argparse.ArgumentParser, rounds: int, burst: float) -> None:
    """Add the options of repeated timings, --rounds, --threads, --burst and --batch, with these defaults."""
    parser.add_argument("--rounds", type=positive, default=rounds, help="number of timings (default: %(default)s)")
    parser.add_argument("--threads", type=positive, default=min(2, netlib.threads()), help="default: %(default)s")
    parser.add_argument("--burst", type=positive_number, default=burst, metavar="S",
                        help="duration of a timing, at least one call (default: %(default)s)")
    add_batch(parser)


def add_batch(parser: argparse.ArgumentParser) -> None:
    """Add the option --batch."""
    parser.add_argument("--batch", type=positive, default=512, metavar="N",
                        help="large batch; the small batch is an eighth of it (default: %(default)s)")


def small(batch: int) -> int:
    """Return the small batch for a large one."""
    return max(2, batch // 8)


class Paper:
    """Depth images (N, 1, 128, 128) and joints (N, 93) of two large batches of hands, and nets that read them."""

    def __init__(self, folder: Path, batch: int, workers: int) -> None:
        from handpose.synthetic.generator import Generator
        from handpose.synthetic.many import generate

        self.folder = folder
        blocks = list(generate(2 * batch, Generator(seed=0, split="train"), workers=workers))
        self.depth = np.concatenate([b.depth for b in blocks]).reshape(-1, 1, 128, 128)
        self.joint = np.concatenate([b.joint for b in blocks]).reshape(-1, 93)
        with h5py.File(folder / "a.h5", "w") as file:
            file["depth"], file["joint"] = self.depth, self.joint
        (folder / "list.txt").write_text("a.h5\n")

    def solver(self, batch: int, engine: str | None = None) -> Solver:
        """Return a solver of the paper's training."""
        net = (ROOT / "prototxt" / "nyu_train_test.prototxt").read_text()
        for name in ("train", "test"):
            net = net.replace(f"data/nyu/{name}.txt", str(self.folder / "list.txt"))
        (self.folder / "net.prototxt").write_text(net.replace("batch_size: 512", f"batch_size: {batch}"))
        path = self.folder / "solver.prototxt"
        path.write_text(
            f'net: "{self.folder}/net.prototxt" base_lr: 0.003 momentum: 0.9 lr_policy: "fixed" random_seed: 1'
        )
        return netlib.get_solver(path, engine=engine)

    def deploy(self, batch: int, engine: str | None = None) -> Net:
        """Return the deploy net, after one forward pass."""
        net = Net(ROOT / "prototxt" / "nyu_deploy.prototxt", netlib.TEST, seed=1, engine=engine)
        for name in WEIGHTS[3:]:  # larger than the fillers' 0.001, so that outputs vary between images
            net.params[name][0].data[...] = np.random.default_rng(0).normal(0, 0.03, net.params[name][0].shape)
        net.forward(depth=self.depth[:batch])
        return net
