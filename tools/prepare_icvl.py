#!/usr/bin/env python3
"""Prepare the ICVL hand posture data set: convert raw frames and labels to the HDF5 files that
the nets read.

    python tools/prepare_icvl.py ICVL_ROOT --check
    python tools/prepare_icvl.py ICVL_ROOT --out data/icvl

ICVL_ROOT has Training/labels.txt and Training/Depth/..., Testing/test_seq_1.txt,
Testing/test_seq_2.txt and Testing/Depth/... --check only reports what exists and what is missing.

Crops are 128 x 128 around the annotated palm (or the --center given), cube 250 mm, resized by
nearest neighbour; 16 joints. The output is train_000.h5, ... of 2,500 frames each, test_000.h5 with
the two test sequences in order, and the lists train.txt and test.txt. Existing files are kept, so
an interrupted run continues. Bad frames are reported, counted and skipped.

A --center FILE has one line "u v d" (px, px, mm) per frame of the split; "{split}" in its name is
replaced by train and test.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from handpose.datasets import icvl_files
from tools.common import preparing
from tools.common.preparing import Importer

ICVL = Importer(
    root="ICVL_ROOT",
    out=Path("data/icvl"),
    center="palm",
    check=icvl_files.check_split,
    read=icvl_files.read_split,
)


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    return preparing.main(argv, __doc__, ICVL)


if __name__ == "__main__":
    sys.exit(main())
