"""Errors in a data set on disk, and guesses at what else a folder contains."""

from __future__ import annotations

import contextlib
import os
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Flaw:
    """One error of a data set: its message."""

    text: str
    fatal: bool = True  # the run cannot continue


def recognise(root: Path) -> str | None:
    """A description of the folder's likely content, or None if it is unknown."""
    try:
        names = {entry.name for entry in root.iterdir()}
    except OSError:
        return None
    below = {f"{a}/{b}" for a in names & {"train", "test", "Training", "Testing", "P0", "P1"} for b in _some(root / a)}
    if any(b.endswith("/joint_data.mat") or "/depth_1_" in b for b in below):
        return "the NYU hand pose data set"
    if {"Training", "Testing"} & names or "Training/labels.txt" in below:
        return "the ICVL data set"
    if {"P0", "P1"} & names:
        return "the MSRA15 data set"
    if any(name.endswith(".h5") for name in names):
        return "HDF5 files that are prepared already"
    packed = sorted(name for name in names if name.lower().endswith((".zip", ".tar", ".gz", ".7z", ".rar", ".tgz")))
    if packed:
        return f"an archive that is not unpacked ({packed[0]})"
    if names and all(name.endswith((".txt", ".md")) for name in names):
        return "only text files, as of published predictions and ground truth, no depth frames"
    return None if names else "nothing"


def _some(folder: Path) -> list[str]:
    """Some names in a folder, including those of labels."""
    found = [name for name in ("joint_data.mat", "labels.txt") if (folder / name).is_file()]
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        found += [entry.name for entry, _ in zip(entries, range(1000))]
    return found
