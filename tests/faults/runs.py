"""Runs of all code that writes files, and functions that interrupt them at any file event.

    answer = forked(lambda: at_event(7, kill) or run())       # killed just before its 7th file event

A run is forked from a process that has already imported all modules, so hundreds of runs take seconds.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import importlib
import io
import itertools
import json
import os
import re
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import netlib  # before NumPy: it chooses the BLAS threads

# isort: split

import h5py
import numpy as np

from handpose.output.drawing import strokes
from handpose.synthetic import prior_file
from netlib.errors import NetlibError
from netlib.files import atomic, hdf5_check, hdf5_helper
from tests.faults import readers
from tests.faults.isolation import BrokenPromise, outcome_of_error
from tests.faults.readers import digest

# ---------------------------------------------------------------------------------------------- the runs

LONGEST_S = 600  # time limit of a child
FOREIGN = ".foreign_iter_5.caffemodel.h5.4194305.tmp"  # of an impossible process id: must not be removed


@dataclass(frozen=True)
class Run:
    """A function that writes files to the working directory.

    prepare  creates the files that exist before
    run      the run itself; a second run continues where the first was stopped. Returns the result
    check    checks the files after any interruption, before the second run; its argument is the digest of the result
             of an undisturbed ``run``
    """

    name: str
    prepare: Callable[[], Any]
    run: Callable[[], Any]
    check: Callable[[str], None] = lambda result: None


def train() -> Any:
    """Train to the end, from the last state if there is one."""
    solver = netlib.get_solver("solver.prototxt", seed=3)
    solver.solve(last_state())
    return readers.everything(solver)


def last_state() -> Path | None:
    """The state of the highest iteration for which both files of the pair exist."""
    found = {int(re.findall(r"_iter_(\d+)\.", path.name)[0]): path for path in Path().glob("s_iter_*.solverstate*")}
    return found[max(found)] if found else None


def check_states(result: str) -> None:
    """Check that every solver state can be restored."""
    for path in Path().glob("s_iter_*.solverstate*"):
        netlib.get_solver("solver.prototxt").restore(path)


def make_old_pair(layout: str) -> None:
    """Write a pair of another training under the names that the run will use."""
    readers.make_solver(layout)
    Path("old.txt").write_text(digest(_two_iterations(0.01)))


def overwrite_pair() -> Any:
    """Train two iterations of another training with the same file names."""
    return _two_iterations(0.05)


def _two_iterations(base_lr: float) -> Any:
    solver = netlib.get_solver("solver.prototxt", seed=3, max_iter=2, base_lr=base_lr)
    solver.solve()
    return readers.parameters(solver)


def check_old_or_new(result: str) -> None:
    """Check that the files are the complete old pair or the complete new one."""
    path = next(Path().glob("s_iter_2.solverstate*"), None)
    if path is None:
        raise BrokenPromise("LOST", "no state under its name, neither old nor new")
    solver = netlib.get_solver("solver.prototxt")
    solver.restore(path)
    if digest(readers.parameters(solver)) not in (Path("old.txt").read_text(), result):
        raise BrokenPromise("LOST", "neither the old pair nor the new one")


def write_weights() -> Any:
    """Replace old weights by new ones, in both formats."""
    net = netlib.Net("vision.prototxt", netlib.TRAIN, seed=2)
    for name in ("vision.caffemodel", "vision.caffemodel.h5"):
        net.save(name)
    return [[blob.data for blob in blobs] for blobs in net.params.values()]


def make_old_weights() -> None:
    """Write weights of the same net with another seed."""
    readers.put("vision.prototxt", readers.VISION)
    for name in ("vision.caffemodel", "vision.caffemodel.h5"):
        netlib.Net("vision.prototxt", netlib.TRAIN, seed=1).save(name)


def check_weights(result: str) -> None:
    """Check that the weights can be read."""
    for name in ("vision.caffemodel", "vision.caffemodel.h5"):
        netlib.Net("vision.prototxt", netlib.TRAIN).copy_from(name, strict=True)


def make_texts() -> None:
    """Write an old file of each kind."""
    readers.put("vision.prototxt", readers.VISION)
    write_texts("old")


def write_texts(word: str = "new") -> Any:
    """Replace an old text, mean image, picture, fitted poses and model by new ones."""
    from handpose.estimate.packaged import write_model
    from handpose.fit.joints.absolute_joints import AbsoluteFit, write_fit
    from netlib.proto.binaryproto import write_blob
    from tools.common import outputs

    value = {"old": 1, "new": 2}[word]
    atomic.replace_text(Path("text.txt"), word * 1000)
    write_blob(np.full((1, 3, 4, 5), value, np.float32), "mean.binaryproto")
    outputs.write_image("picture.png", np.full((8, 8, 3), value, np.uint8))
    ones = np.full((2, 3), float(value))
    write_fit(Path("fit.h5"), AbsoluteFit(ones, ones, ones, ones[:, 0]), np.arange(2))
    write_model(netlib.Net("vision.prototxt", netlib.TRAIN, seed=value), None, Path("model.h5"))
    return value


def check_texts(result: str) -> None:
    """Check that each file is the old one or the new one."""
    if Path("text.txt").read_text() not in ("old" * 1000, "new" * 1000):
        raise BrokenPromise("LOST", "text.txt is neither old nor new")
    readers.read_mean(Path("mean.binaryproto"))
    readers.read_image(Path("picture.png"))
    for name in ("fit.h5", "model.h5"):
        h5py.File(name, "r").close()


def make_database() -> None:
    """Write pictures and their list."""
    readers.make_pictures()


def write_database() -> Any:
    """Write a database of the pictures by tools/convert_imageset.py, which never replaces a database."""
    from tools.common import databases

    if not Path("new_db").exists():
        readers.read_imageset(Path("list.txt"))
    return [value for _, value in databases.read_database("new_db")[1]]


def prepare_data() -> Any:
    """Write the parts and lists of a data set of three frames, one of which is missing."""
    readers._prepare()
    with h5py.File("out/test_000.h5", "r") as file:
        return {name: file[name][...] for name in file}


def fit_companions() -> Any:
    """Fit the angles for a file of frames."""
    inputs, _ = readers._fit_companion()
    return inputs


TRACK_FILES = {"json": "json", "csv": "csv", "bvh": "bvh", "video": "mp4", "sheet": "png"}  # options and endings


def make_old_tracks() -> None:
    """Write old tracks of three frames."""
    write_tracks(3)


def write_tracks(frames: int = 2) -> Any:
    """Replace a track as JSON, CSV, BVH, video and sheet, all at once as tools/track.py does."""
    from layers.hand import skeleton
    from tests.support.made_tracks import any_track, header_of
    from tools.common.track_outputs import Outputs, add_output_options

    parser = argparse.ArgumentParser()
    add_output_options(parser)
    names = {f"--{kind}": f"a.{ending}" for kind, ending in TRACK_FILES.items()}
    header = header_of(skeleton.load())
    outputs = Outputs(parser.parse_args(list(itertools.chain(*names.items()))), header, 30.0)
    with outputs:
        for frame in any_track(header, 1, frames):
            outputs.write(np.full((header.camera.height, header.camera.width), 900, np.float32), frame)
    return [Path(name).read_bytes() for name in sorted(outputs.written)]


def check_tracks(result: str) -> None:
    """Check that each file is complete: the old one, the new one, or the part of it that fitted on the disk."""
    import av

    from handpose.output.tracks.json_file import read_track

    read_track("a.json")
    readers.read_image(Path("a.png"))
    with av.open("a.mp4") as video:
        if not any(True for _ in video.decode(video=0)):
            raise BrokenPromise("LOST", "a.mp4 shows nothing")
    if not Path("a.csv").read_text().endswith("\n"):
        raise BrokenPromise("LOST", "a.csv ends within a row")
    for path in Path().glob("a_*.bvh"):
        text = path.read_text()
        if len(text.split("Frame Time: ")[1].splitlines()) - 1 != int(text.split("Frames: ")[1].split()[0]):
            raise BrokenPromise("LOST", f"{path} has not as many frames as it says")


RECORDINGS = ("frames", "stack.npz", "take.mkv")


def write_recordings(value: int = 2) -> Any:
    """Replace an old folder of frames, stack and video by new ones."""
    from handpose.frames.cameras import Camera
    from handpose.frames.recording import DepthFrame
    from handpose.frames.writing import RecordingWriter

    for name in RECORDINGS:
        with RecordingWriter(Path(name), Camera("own", 60, 60, 4, 3, 8, 6), 0.5, 30, replace=True) as writer:
            for i in range(3):
                writer.write(DepthFrame(i, i / 30, np.full((6, 8), value, np.float32)))
    return read_recordings()


def read_recordings() -> Any:
    """Read all recordings as far as possible."""
    from handpose.frames.opening import open_recording

    return [[(frame.time, frame.depth) for frame in open_recording(name)] for name in RECORDINGS]


def check_recordings(result: str) -> None:
    """Check that a stack or video is the old one or the new one, and that all frames in a folder are complete."""
    from handpose.frames.opening import open_recording

    for name in RECORDINGS[1:]:
        means = [float(frame.depth.mean()) for frame in open_recording(name)]
        if len(means) != 3 or len(set(means)) != 1:
            raise BrokenPromise("LOST", f"{name} is neither old nor new")
    if list(Path("frames").glob("0*.png")):
        recording = open_recording("frames")
        list(recording)
        if any("damaged" in remark for remark in recording.remarks):
            raise BrokenPromise("LOST", "a frame in the folder is not whole")


SYNTHETIC = ("made", "stack.npz", "take.mkv")


def make_recordings(seed: int = 2) -> Any:
    """Replace old recordings and their truths by new ones, as tools/make_recording.py does."""
    from handpose.frames.cameras import Camera
    from tools import make_recording

    for name in SYNTHETIC:
        options = {"rate": 20.0, "seconds": 0.1, "hand": None, "clean": True, "seed": seed, "force": True}
        camera = Camera("own", 30, 30, 16, 12, 32, 24)
        with contextlib.redirect_stdout(io.StringIO()):
            make_recording.run(argparse.Namespace(script="rest", out=Path(name), camera=camera, **options))
    return [read_pair_of_recording(name) for name in SYNTHETIC]


def make_old_recordings() -> None:
    """Write recordings with another seed, and record the pairs of both seeds."""
    pairs = [*make_recordings(2), *make_recordings(1)]
    Path("expected.txt").write_text(" ".join(map(digest, pairs)))


def read_pair_of_recording(name: str) -> Any:
    """Read depth and truth; None if a file does not exist."""
    from handpose.frames.opening import open_recording

    truth = Path(f"{Path(name).stem}.truth.json")
    frames = [(frame.time, frame.depth) for frame in open_recording(name)] if Path(name).exists() else None
    return frames, truth.read_text() if truth.exists() else None


def check_pairs_of_recordings(result: str) -> None:
    """Check that every truth is next to its own recording."""
    expected = Path("expected.txt").read_text().split()
    for name in SYNTHETIC:
        frames, truth = read_pair_of_recording(name)
        if truth is not None and digest((frames, truth)) not in expected:
            raise BrokenPromise("LOST", f"{name} and its truth are of two runs")


RUNS: tuple[Run, ...] = (
    Run("training hdf5", functools.partial(readers.make_solver, "HDF5"), train, check_states),
    Run("training binary", functools.partial(readers.make_solver, "BINARYPROTO"), train, check_states),
    Run("old pair hdf5", functools.partial(make_old_pair, "HDF5"), overwrite_pair, check_old_or_new),
    Run("old pair binary", functools.partial(make_old_pair, "BINARYPROTO"), overwrite_pair, check_old_or_new),
    Run("weights", make_old_weights, write_weights, check_weights),
    Run("texts and pictures", make_texts, write_texts, check_texts),
    Run("database", make_database, write_database),
    Run("prepared data", readers.make_frames, prepare_data),
    Run("companions", readers.make_labels, fit_companions),
    Run("tracks", make_old_tracks, write_tracks, check_tracks),
    Run("recordings", functools.partial(write_recordings, 1), write_recordings, check_recordings),
    Run("recordings and truths", make_old_recordings, make_recordings, check_pairs_of_recordings),
)


def run_of(name: str) -> Run:
    """Return the run with this name."""
    return next(run for run in RUNS if run.name == name)


# ---------------------------------------------------------------------------------------------- where they run


@dataclass(frozen=True)
class Undisturbed:
    """A run without interruption.

    folder  the folder before the run; interrupted runs use copies of it
    result  digest of the result of the run
    names   names of all files after the run
    """

    run: Run
    folder: Path
    result: str
    names: list[str]


@functools.cache
def undisturbed(name: str) -> Undisturbed:
    """Prepare a run and complete it, once per process."""
    run = run_of(name)
    folder = Path(f"before.{name.replace(' ', '_')}").resolve()
    folder.mkdir()
    with readers._inside(folder):
        status, _ = forked(run.prepare)
        Path(FOREIGN).touch()
    with readers._copied(folder):
        status, answer = forked(lambda: " ".join([digest(run.run()), *sys.modules]))
        if status or not isinstance(answer, str):
            raise BrokenPromise("BROKEN", f"{name}: ends with {status} when nothing happens: {answer}")
        result, *modules = answer.split()
        netlib.layer_type_list()
        for module in modules:  # imported here once instead of in every child
            if module not in sys.modules:
                with contextlib.suppress(ImportError):  # an entry that a package added itself
                    importlib.import_module(module)
        prior_file.load()  # also reads the packaged hand and the font once
        strokes.text_width("", 1)
        return Undisturbed(run, folder, result, names())


def names() -> list[str]:
    """Names of all files in the working directory."""
    return sorted(str(path) for path in Path().rglob("*"))


def finish(before: Undisturbed, what: str, may_stay: str = "") -> None:
    """Check that a second run has the result and the files of an undisturbed run.

    ``may_stay`` is a pattern of names of additional files that are allowed.
    """
    status, checked = forked(lambda: before.run.check(before.result))
    expect_good(status, checked, f"right after {what}")
    status, result = forked(lambda: digest(before.run.run()))
    expect_good(status, result, f"the next run after {what}")
    if result != before.result:
        raise BrokenPromise("SILENT", f"the next run after {what} ends with another result")
    extra = sorted(set(names()) - set(before.names))
    if left := [name for name in extra if not may_stay or not re.fullmatch(may_stay, name)]:
        raise BrokenPromise("LEFT", f"after {what} and the next run there is still {left[0]}")
    if missing := set(before.names) - set(names()):
        raise BrokenPromise("LOST", f"after {what} and the next run there is no {sorted(missing)[0]}")


def expect_good(status: int, answer: Any, what: str) -> None:
    """Raise BrokenPromise if a child did not succeed."""
    if status < 0:
        raise BrokenPromise("CRASH", f"{what}: ended by {signal.Signals(-status).name}")
    if isinstance(answer, list):
        raise BrokenPromise(answer[0].upper(), f"{what}: {answer[1]}")


# ---------------------------------------------------------------------------------------------- children and events


class Event:
    """An event for one process to wait for and a forked one to set, or the other way round; made before the fork."""

    def __init__(self) -> None:
        self._readable, self._writable = os.pipe()

    def set(self) -> None:
        """Set the event."""
        os.close(self._readable)
        os.close(self._writable)

    def wait(self) -> None:
        """Wait until the other process has set the event, or has ended."""
        os.close(self._writable)
        os.read(self._readable, 1)
        os.close(self._readable)


def forked(
    function: Callable[[], Any], meanwhile: Callable[[int], None] = lambda child: None
) -> tuple[int, str | list[str] | None]:
    """Run a function in a forked child. Returns its exit status, negative for a signal, and its answer.

    The answer is a text, or a list [kind, detail] for an exception: "refused" for a NetlibError or OSError.
    ``meanwhile`` is called with the child's process number while it runs.
    """
    readable, writable = os.pipe()
    child = os.fork()
    if child == 0:
        status = 99
        try:
            status, answer = _answered(function)
            os.write(writable, json.dumps(answer).encode())
        finally:  # a child must never continue as its parent
            os._exit(status)
    os.close(writable)
    meanwhile(child)
    with os.fdopen(readable) as answers:
        text = answers.read()
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    return status, json.loads(text) if text else None


def _answered(function: Callable[[], Any]) -> tuple[int, str | list[str] | None]:
    """Run the function in the child; returns the exit status and the answer.

    The child checks HDF5 files in its own process, because starting a helper process for each of hundreds of children
    would take most of the time; the campaign of readers tests the helper. An alarm ends the child if its parent ended.
    """
    hdf5_helper.fault_of = lambda path, content: hdf5_check.fault_of(path)  # type: ignore[assignment]
    signal.alarm(LONGEST_S)
    try:
        answer = function()
    except NetlibError as error:
        return 1, ["refused", str(error)]
    except OSError as error:  # like tools/common/console.py, if the error has a file name
        kind = "refused" if error.filename else "UNCLEAR"
        return 1, [kind, f"{error.filename}: {error.strerror}" if error.filename else f"{error} without a name"]
    except BaseException as error:
        found = outcome_of_error(error)
        return 1, [found.kind, found.detail]
    return 0, answer if isinstance(answer, str) else None


CREATING = ("open", "os.mkdir", "os.link", "os.symlink", "fsync", "fallocate", "H5Fcreate", "os.truncate")
EVENTS = (*CREATING, "os.rename", "os.remove", "os.rmdir", "fcntl.flock", "fcntl.lockf")
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC


def at_events(action: Callable[[int, str, str | None], None]) -> None:
    """Call ``action(number, event, path)`` before every later change of a file; only for forked children."""
    done = 0

    def happens(event: str, arguments: tuple[Any, ...]) -> None:
        nonlocal done
        if event not in EVENTS:
            return
        if event == "open" and (isinstance(arguments[0], int) or not (arguments[2] or 0) & _WRITING):
            return
        path = os.fsdecode(arguments[0]) if arguments and isinstance(arguments[0], (str, bytes, os.PathLike)) else None
        if path and ("__pycache__" in path or path.startswith(("/dev/", "<_io"))):  # "<_io": HDF5 in memory
            return
        done += 1
        action(done, event, path)

    for module, name, event in (
        (os, "fsync", "fsync"),
        (os, "posix_fallocate", "fallocate"),
        (h5py.h5f, "create", "H5Fcreate"),
    ):
        setattr(module, name, _told(getattr(module, name), functools.partial(happens, event)))
    sys.addaudithook(happens)


def _told(function: Callable[..., Any], tell: Callable[[tuple[Any, ...]], None]) -> Callable[..., Any]:
    def told(*arguments: Any, **named: Any) -> Any:
        tell(arguments)
        return function(*arguments, **named)

    return told
