"""A campaign for Table 1: generates data, fits angles, trains and scores until all is done or time is up."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from experiments.table1 import results, store, trainings
from experiments.table1.plan import Job, convergence_of, next_length, of_job, report
from experiments.table1.results import Truth
from experiments.table1.settings import ONE_HAND, Setting, is_real_nyu
from experiments.table1.speed import machine
from experiments.table1.store import Entry
from experiments.table1.trainings import Step, Training
from experiments.table1.true_angles import fit_true_angles
from handpose.estimate.nets import trained
from handpose.scoring.held_out import predict_all
from handpose.synthetic.generator import Split
from layers.hand import skeleton as skeletons
from netlib import engine
from netlib.blob import Array
from netlib.errors import DataError, NetlibError, reason_of
from netlib.files.hdf5 import File
from netlib.solver import Solver
from tools.common import training
from tools.common.console import DONE, duration, say
from tools.common.progress import ProgressBar, fill_folder

SKELETON = skeletons.load()


class EndedError(Exception):
    """A signal or failure that ends the campaign with this exit status."""

    def __init__(self, status: int) -> None:
        self.status = status


class TimeUpError(Exception):
    """The deadline passed while data were made."""


class Data(NamedTuple):
    """The data of a setting: name, training files, and ground truth of the test frames."""

    name: str
    files: list[Path]
    truth: Truth


@dataclass
class Campaign:
    """Executes training runs until a deadline.

    store    folder of the recorded results
    work      folder of nets and snapshots
    command   command line, recorded with the results
    deadline  in terms of time.monotonic()
    longest   maximum length in iterations
    threads   number of threads; None for the default
    """

    store: Path
    work: Path
    command: str
    deadline: float = float("inf")
    longest: int | None = None
    threads: int | None = None
    entries: dict[str, list[Entry]] = field(default_factory=dict)
    data: dict[str, Data] = field(default_factory=dict)
    labelled: set[str] = field(default_factory=set)  # settings with fitted angles of the training frames

    def cost(self, jobs: Sequence[Job]) -> str:
        """What the missing lengths of some training runs need, in words. Raises DataError."""
        left = [job for job in jobs if next_length(self.store_of(job.setting), job, self.longest) is not None]
        hours = report(jobs, self.store_of, self.longest)[-1][-1]
        about = "an unknown time" if hours == "not known" else f"about {hours} hours on the machine of the results"
        words = f"{len(left)} of {len(jobs)} training runs are missing: {about}"
        sets = [setting.data_set() for setting in {job.setting.name: job.setting for job in left}.values()]
        missing = [data for data in sets if data is not None and not data.is_whole]
        if missing:
            frames, size = (sum(each) for each in zip(*((data.missing_frames, data.missing_bytes) for data in missing)))
            words += f"; first {frames} frames of {size / 1e9:.1f} GB are made"
        return words

    def run(self, jobs: Sequence[Job]) -> int:
        """Run the missing lengths of some training runs; returns the exit status. Raises NetlibError."""
        try:
            for number, job in enumerate(jobs, 1):
                self._run(job, f"[{number} of {len(jobs)}]")
                if self.is_over:
                    say_now("time is up; the next run continues here")
                    return DONE
        except EndedError as stopped:
            return stopped.status
        except TimeUpError:
            say_now("time is up; the next run continues here")
        return DONE

    def _until_over(self, advance: Callable[[int], None]) -> Callable[[int], None]:
        """``advance``, which raises TimeUpError after the deadline."""

        def advance_or_stop(count: int) -> None:
            advance(count)
            if self.is_over:
                raise TimeUpError

        return advance_or_stop

    @property
    def is_over(self) -> bool:
        """Whether the deadline has passed."""
        return time.monotonic() >= self.deadline

    def store_of(self, setting: Setting) -> list[Entry]:
        """The recorded results of a setting. Raises DataError."""
        if setting.name not in self.entries:
            self.entries[setting.name] = store.read_all(self.store, setting.name)
        return self.entries[setting.name]

    def _run(self, job: Job, which: str) -> None:
        """Train and score one length after the other until none is left or time is up."""
        while (length := next_length(self.store_of(job.setting), job, self.longest)) is not None and not self.is_over:
            data = self._data(job)
            folder = trainings.work_folder(self.work, job.setting, data.name, job.network)
            _make(folder)
            one = Training(job.setting, job.network, job.recipe, job.seed, folder)
            while (step := one.next_step(length, data.files)) is not None:
                say_now(f"{which} {job}: {step.first} of {length} iterations done: {step}")
                if not self._train(one, step):
                    return
            begun = time.perf_counter()
            entry = self._score(one, length, data)
            self.store_of(job.setting).append(entry)
            one.forget_end(length)
            end = (
                "done" if job.only else convergence_of(of_job(self.store_of(job.setting), job), job.recipe.lengths).end
            )
            say_now(f"{which} {job}: {length} iterations, {entry.error_mm:.2f} mm, {end}; "
                    f"scored in {duration(time.perf_counter() - begun)}")

    # ------------------------------------------------------------------------------------------ data

    def _data(self, job: Job) -> Data:
        """The data of a job, generated if missing; angles of training frames are fitted only if needed."""
        setting = job.setting
        if setting.name not in self.data:
            files = self._frames(setting)
            name = trainings.data_name([*files, *setting.files("test")])
            other = sorted({entry.data for entry in self.store_of(setting)} - {name})
            if other:
                raise DataError(f"{self.store / setting.name}: was made with the data {', '.join(other)}, those in "
                                f"{setting.folder} are {name}; choose another --ledger")
            truth = results.truth_of(setting, self._angles(setting, "test"))
            self.data[setting.name] = Data(name, files, truth)
        if job.network.labels == "fitted" and setting.name not in self.labelled:
            self._angles(setting, "train")
            self.labelled.add(setting.name)
        return self.data[setting.name]

    def _frames(self, setting: Setting) -> list[Path]:
        """The training files of a setting, generated if missing and possible."""
        data = setting.data_set()
        if data is not None and not data.is_whole:
            say_now(f"{setting.folder}: making {data.missing_frames} frames")
            workers = self.threads or engine.available_cpus()
            status = fill_folder(setting.folder, "whole files are", data.missing_frames,
                                 lambda advance: data.write(workers, self._until_over(advance)))
            if status != DONE:
                raise EndedError(status)
        found = setting.files("train")
        if data is None and not is_real_nyu(setting):
            raise DataError(f"{setting.folder}: holds frames that prepare_nyu did not make; expected the NYU data "
                            f"set, or --setting {ONE_HAND.name}")
        return found

    def _angles(self, setting: Setting, split: Split) -> Array:
        """The angles (N, D) of a split, fitted if missing."""
        begun = time.perf_counter()
        files = setting.files(split)
        with ProgressBar(sum(File(path, ("joint",)).rows for path in files), what=f"angles of {split}") as progress:
            inputs, residuals = fit_true_angles(split, files, setting.angles, SKELETON, self._until_over(progress))
        say_now(f"{setting.folder}, {split}: fitted the hand to {len(inputs)} frames, residual "
                f"{np.nanmean(residuals):.2f} mm, {duration(time.perf_counter() - begun)}")
        return inputs

    # ------------------------------------------------------------------------------------------ training, scoring

    def _train(self, one: Training, step: Step) -> bool:
        """Run one step of training; False if time was up before its end."""
        weights = [step.weights] if step.weights else []
        last = step.first  # the current iteration

        def watch(solver: Solver) -> None:
            nonlocal last
            last = solver.iter
            if last > step.first and last % one.recipe.every == 0:  # a snapshot was just written
                one.forget_older(step, last)
            if self.is_over:
                solver.requested = "stop"

        begun = time.perf_counter()
        status = training.train(step.solver, snapshot=step.snapshot, weights=weights, threads=self.threads,
                                log_file=step.log, watch=watch)
        one.add_time(step, last + 1 - step.first, time.perf_counter() - begun)
        one.forget_older(step, last + 1)
        if status != DONE:
            raise EndedError(status)
        return not self.is_over

    def _score(self, one: Training, length: int, data: Data) -> Entry:
        """Test one length and record the results."""
        setting, network = one.setting, one.network
        net = trained(one.net, one.weights_of(length))
        predictions = predict_all(net)
        if not (self.store / setting.name / store.WHERE).is_file():
            store.write_shown(self.store, setting.name, results.shown_frames(setting, predictions, net))
        with ProgressBar(len(predictions.joints) if network.by_fit else 0, what="angles") as progress:
            inputs = results.angles_of(predictions, SKELETON, progress)
        error, subjects = results.figures(setting, predictions, inputs, data.truth, SKELETON)
        entry = Entry(
            setting=setting.name, network=network.name, recipe=one.recipe.name, seed=one.seed, iterations=length,
            error_mm=error, seconds=one.seconds(length), threads=self.threads or engine.get().threads(),
            machine=machine(), data=data.name, made_from=predictions.made_from, command=self.command, subjects=subjects,
            shown=predictions.joints[results.frames_to_show(setting, predictions)],
        )
        store.write(self.store, entry)
        return entry


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise NetlibError(f"{folder}: cannot make the folder: {reason_of(error)}") from None


def say_now(text: str) -> None:
    """Print a status line to stderr."""
    say(text, file=sys.stderr)
