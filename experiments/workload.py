"""A net of the benchmarks, ready to run a forward pass or a training step."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import netlib
from experiments.example_nets import Example, hands
from netlib.blob import Array
from netlib.net import Net
from netlib.solver import Solver

TRAINING = 'base_lr: 0.0001 momentum: 0.9 lr_policy: "fixed" random_seed: 1'


class Workload:
    """A net that repeats a forward pass or a training step: ``run()``. Its files are in a folder.

    inputs  arrays by the names of the net's inputs
    """

    def __init__(self, example: Example, folder: Path, engine: str | None = None) -> None:
        self.path = folder / f"{example.name}.prototxt"
        self.path.write_text(example.text(folder), encoding="utf-8")
        self.solver: Solver | None = None
        rng = np.random.default_rng(0)
        if example.trains:
            solver = folder / "solver.prototxt"
            solver.write_text(f'net: "{self.path.as_posix()}" {TRAINING}', encoding="utf-8")
            self.solver = netlib.get_solver(solver, engine=engine)
            self.net = self.solver.net
        else:
            self.net = Net(self.path, netlib.TEST, seed=1, engine=engine)
            fill(self.net, rng)
        self.inputs = _random_inputs(self.net, rng)
        if example.batch:
            self.inputs = {"depth": hands(example.batch)[0]}
        if self.solver:
            for name, values in self.inputs.items():
                self.net.blobs[name].data[...] = values

    def run(self) -> Array | None:
        """Run the net once; returns the output of a forward pass."""
        if self.solver:
            self.solver.step(1)
            return None
        return next(iter(self.net.forward(**self.inputs).values()))  # type: ignore[arg-type]


def _random_inputs(net: Net, rng: np.random.Generator) -> dict[str, Array]:
    """Data, and labels of ten classes; no sequence ends."""
    inputs: dict[str, Array] = {}
    for name in net.inputs:
        shape = net.blobs[name].shape
        values = rng.normal(size=shape) if name == "data" else rng.integers(0, 10, shape)
        inputs[name] = values.astype(np.float32)
    if "cont" in inputs:
        inputs["cont"].fill(1)
    return inputs


def fill(net: Net, rng: np.random.Generator) -> None:
    """Fill the statistics of BatchNorm layers, the gains of Scale layers, and the biases with
    random numbers.
    """
    for layer in net.layers:
        arrays = [param.data for param in layer.blobs]
        if layer.type == "BatchNorm":
            mean, variance, factor = arrays
            mean[...] = rng.normal(0, 0.1, mean.shape)
            variance[...] = rng.uniform(0.5, 1.5, variance.shape)
            factor[...] = 1
            continue
        if layer.type == "Scale":
            arrays[0][...] = rng.normal(1, 0.1, arrays[0].shape)
        for bias in arrays[1:]:
            bias[...] = rng.normal(0, 0.1, bias.shape)
