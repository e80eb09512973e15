"""The speed of the network of Table 1 on this machine in frames per second, compared with the paper's 125."""

from __future__ import annotations

import json
import platform
import re
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

import netlib
from experiments.table1.networks import PROTOTXT
from handpose.frames.json_fields import Fields, parsed
from handpose.synthetic.generator import Generator
from netlib import engine, files
from netlib.blob import Array
from netlib.files import atomic
from netlib.net import Net

DEPLOY = PROTOTXT / "nyu_deploy.prototxt"
BATCH, ROUNDS = 64, 50
CPUINFO = Path("/proc/cpuinfo")  # file of Linux
WHERE = "speed.json"  # in the folder of the results store


@dataclass(frozen=True)
class Speed:
    """Frames per second of one forward pass: medians over ``ROUNDS``."""

    single: float
    batched: float
    batch: int
    engine: str
    threads: int
    machine: str


def measure(rounds: int = ROUNDS) -> Speed:
    """Measure the speed on synthetic hands; it does not depend on the weights. Raises NetlibError."""
    net = Net(DEPLOY, netlib.TEST, seed=1)
    depth = Generator(seed=1, split="test").block(0).depth[:BATCH]
    single, batched = (count / _seconds(net, depth[:count], rounds) for count in (1, BATCH))
    used = engine.get()
    return Speed(single, batched, BATCH, used.name, used.threads(), machine())


def _seconds(net: Net, depth: Array, rounds: int) -> float:
    """The median of one forward pass, after a first one that allocates the buffers."""
    net.blobs["depth"].reshape(*depth.shape)
    net.forward(depth=depth)
    times = []
    for _ in range(rounds):
        begun = time.perf_counter()
        net.forward(depth=depth)
        times.append(time.perf_counter() - begun)
    return float(np.median(times))


def write(path: Path, speed: Speed) -> None:
    """Write the file atomically. Raises OSError."""
    atomic.replace_bytes(path, (json.dumps(asdict(speed), indent=1) + "\n").encode())


def read(path: Path) -> Speed | None:
    """The measured speed, or None. Raises DataError."""
    if not path.is_file():
        return None
    of = Fields(parsed(files.read_text(path, "the speed"), str(path)), str(path))
    return Speed(of.positive("single"), of.positive("batched"), of.whole("batch"), of.text("engine"),
                 of.whole("threads"), of.text("machine"))


def machine() -> str:
    """The processor, and the number of its cores that this process may use."""
    cores = engine.available_cpus()
    return f"{_processor()}, {cores} core{'s' * (cores != 1)}"


def _processor() -> str:
    try:
        found = re.search(
            r"^model name\s*:\s*(.+)$", CPUINFO.read_text(encoding="utf-8", errors="replace"), re.MULTILINE
        )
    except OSError:
        found = None
    return " ".join(found[1].split()) if found else platform.processor() or platform.machine()
