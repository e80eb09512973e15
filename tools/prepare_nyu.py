#!/usr/bin/env python3
"""Prepare the NYU hand pose data set: convert raw frames and labels to the HDF5 files that
the nets read.

    python tools/prepare_nyu.py NYU_ROOT --check
    python tools/prepare_nyu.py NYU_ROOT --out data/nyu

NYU_ROOT has the folders train and test (or dataset/train and dataset/test), each with
depth_1_0000001.png, depth_1_0000002.png, ... and joint_data.mat. --check only reports what exists
and what is missing.

Crops are those of the paper's released system: 128 x 128 around annotated joint 34
(or the --center given), cube 300 mm, 261 mm from test frame 2440 on, resized by nearest neighbour.
The output is train_000.h5, ... of 2,500 frames each, test_000.h5, ..., and the lists train.txt and
test.txt. Existing files are kept, so an interrupted run continues. Bad frames are reported,
counted and skipped.

A --center FILE has one line "u v d" (px, px, mm) per frame of the split; "{split}" in its name is
replaced by train and test.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from handpose.body.nyu import CENTER_JOINT
from handpose.datasets import nyu_files
from tools.common import preparing
from tools.common.preparing import Importer

NYU = Importer(
    root="NYU_ROOT",
    out=Path("data/nyu"),
    center=f"joint{CENTER_JOINT}",
    check=nyu_files.check_split,
    read=nyu_files.read_split,
)


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    return preparing.main(argv, __doc__, NYU)


if __name__ == "__main__":
    sys.exit(main())
