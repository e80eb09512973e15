"""Benchmark of this project against PyTorch, onnxruntime and OpenCV, with the same
nets and weights.

    python -m experiments bench                                   the time, all nets
    python -m experiments bench --cpu --threads 1 --nets LeNet    processor time, on a busy machine

The forward pass of nine well-known nets, of six kinds of small ones, and of the paper's network,
which is called "hand", for 1, 64 and 512 images; a training step of four small nets and of the
paper's network. Outputs and gradients are compared first, and a peer that differs is not timed.
Each net is timed alternately with its peers; the table has the medians, and the ratio: the peer's
time divided by ours (above 1: this project is faster). A package that is not installed is left out.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

import netlib
from experiments.choices import add_choices
from experiments.example_nets import NETS
from experiments.peers import Job, peers_of
from experiments.workload import Workload
from tools.common.arguments import positive, workers
from tools.common.console import notify

MAX_LOAD = 0.5  # of a machine on which times are reproducible
MIN_JOB_S = 0.1  # for which a job is repeated
# before a job: OpenMP's threads, PyTorch's and OpenCV's, spin for some ms after the job before
PAUSE_S = 0.05


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    add_choices(parser, "--nets", NETS)
    parser.add_argument(
        "--rounds", type=positive, default=7, metavar="N", help="number of timings (default: 7)"
    )
    parser.add_argument(
        "--threads",
        type=workers,
        default=min(2, netlib.threads()),
        metavar="N",
        help="default: %(default)s",
    )
    parser.add_argument(
        "--cpu", action="store_true", help="processor time instead of the time, for a busy machine"
    )


def run(args: argparse.Namespace) -> None:
    """Time the nets and print a line for each peer."""
    netlib.set_threads(args.threads)
    cv2.setNumThreads(args.threads)
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    if load > MAX_LOAD and not args.cpu:
        notify(f"warning: the machine is busy (load {load:.1f}); use --cpu and --threads 1")
    unit = "processor time" if args.cpu else "time"
    print(f"{netlib.BLAS_NOTE}; {args.threads} threads; medians of the {unit} in ms")
    print(f"{'':20}{'ours':>9}  {'peer':<24}{'':>9}{'ratio':>7}")
    with tempfile.TemporaryDirectory() as folder:
        for name in args.nets:
            work = Workload(NETS[name], Path(folder))
            peers = dict(peers_of(name, work, args.threads))
            ours, *theirs = medians([work.run, *peers.values()], args.rounds, args.cpu)
            line = f"{name:20}{1e3 * ours:9.2f}"
            for peer, seconds in zip(peers, theirs):
                print(f"{line}  {peer:<24}{1e3 * seconds:9.2f}{seconds / ours:7.2f}", flush=True)
            if not peers:
                print(line, flush=True)


def medians(jobs: list[Job], rounds: int, cpu: bool) -> list[float]:
    """The median times of jobs in s, run alternately; the first round is not counted."""
    clock = time.process_time if cpu else time.perf_counter
    times = np.zeros((rounds + 1, len(jobs)))
    for row in times:
        for number, job in enumerate(jobs):
            time.sleep(PAUSE_S)
            job()  # into the caches
            begun, count = clock(), 0
            while not count or clock() - begun < MIN_JOB_S:
                job()
                count += 1
            row[number] = (clock() - begun) / count
    return [float(value) for value in np.median(times[1:], axis=0)]
