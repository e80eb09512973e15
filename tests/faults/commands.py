"""Every command that writes files, while the system fails it: what it leaves, what it prints, and how it ends.

A case runs the smallest form of a command, with old files in the place of its outputs or without, and with one fault:

- a call: one open, write, sync, close, rename ... below the folder fails, or all from it on, or a write is cut short,
  also within FFmpeg, HDF5 and LMDB (failing_calls.c)
- an object: a link to another file, a folder, a pipe ... in the place of an output, a lock or a folder
- a limit: on the size of files, on descriptors, or on memory
- a clock: all clocks stand still, run backwards or jump

The command must end with the status 0, 1, 2 or 130, without a traceback, with a line that names a file; each file must
be the old one or the new one, with status 0 the new one; other files must not change; and the next run must succeed.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import functools
import importlib
import io
import itertools
import json
import os
import random
import re
import resource
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import netlib  # before NumPy: it chooses the BLAS threads

# isort: split

import cv2
import numpy as np

from tests.faults import readers, runs
from tests.faults.isolation import ROOT, BrokenPromise, Outcome

# ---------------------------------------------------------------------------------------------- the commands


@dataclass(frozen=True)
class Command:
    """A command in its smallest form.

    line     name of the command and its arguments
    prepare  writes its inputs to the working directory
    files    outputs in whose place an old file may be
    parts    outputs that may be incomplete after an error, as docs/reliability.md says: whole lines, frames so far
    """

    line: str
    prepare: Callable[[], object] = lambda: None
    files: tuple[str, ...] = ()
    parts: str = "nothing"

    @property
    def name(self) -> str:
        """Name of its cases."""
        return f"command {self.line}"


def frames(folder: str = "frames", count: int = 2, seed: int = 0) -> None:
    """Write a recording of a hand."""
    from handpose.frames.cameras import ICVL
    from handpose.frames.writing import RecordingWriter
    from handpose.sequences.recordings import SyntheticRecording

    recording = SyntheticRecording("rest", ICVL, rate=15, seconds=count / 15, seed=seed)
    with RecordingWriter(Path(folder), recording.camera, recording.unit_mm, recording.rate) as writer:
        for frame in recording:
            writer.write(frame)


def old_recording() -> None:
    """Write two recordings, one of which will be replaced."""
    frames()
    frames("new", 3, 1)


def data() -> None:
    """Write a data set of a few frames."""
    readers.run_tool(_main("make_synthetic"), "--out", "data", "--train", "4", "--test", "2", "--workers", "1")


def many() -> None:
    """Write a data set of the frames that a calibration needs."""
    readers.run_tool(_main("make_synthetic"), "--out", "data", "--train", "24", "--test", "1", "--workers", "1")


def scored() -> None:
    """Write a data set, and a net for it."""
    data()
    text = (ROOT / "prototxt" / "nyu_train_test.prototxt").read_text(encoding="utf-8").replace("data/nyu", "data")
    readers.put("net.prototxt", re.sub(r"batch_size: \d+", "batch_size: 2", text))
    netlib.Net("net.prototxt", netlib.TRAIN, seed=1).save("n.caffemodel.h5")


def crop() -> None:
    """Write a crop, and weights for the paper's net."""
    netlib.Net(ROOT / "prototxt" / "nyu_deploy.prototxt", netlib.TEST, seed=1).save("net.caffemodel.h5")
    cv2.imwrite("crop.png", np.random.default_rng(0).integers(0, 256, (128, 128), dtype=np.uint8))


def joints() -> None:
    """Write the joints of three hands."""
    from handpose.body.nyu import EVALUATION_JOINTS
    from handpose.synthetic.pose_prior import BodySampler

    xyz = BodySampler().draw(np.random.default_rng(0), 3).joints * 150 + (0, 0, 700)
    np.savetxt("xyz.txt", xyz[:, list(EVALUATION_JOINTS)].reshape(3, -1))


def published() -> None:
    """Write annotations of ICVL, and predictions."""
    for name, move in (("truth", 0), ("near", 3)):
        uvd = np.random.default_rng(0).normal((160, 120, 400), 30, (5, 16, 3)) + (0, 0, move)
        np.savetxt(f"{name}.txt", uvd.reshape(5, 48), fmt="%.6f")


def database() -> None:
    """Write a database of images."""
    readers.make_pictures()
    readers.put("two.txt", "a.png 0\nb.jpg 1\n")
    line = "./ two.txt db -resize_width=4 -resize_height=4"
    readers.run_tool(_main("convert_imageset"), *line.split())


def features() -> None:
    """Write a net of inputs only, and its weights."""
    layer = 'layer { name: "p" type: "InnerProduct" bottom: "data" top: "y" inner_product_param { num_output: 3 } }'
    readers.put("net.prototxt", readers.inputs(data=(1, 3, 4, 5)) + layer)
    netlib.Net("net.prototxt", netlib.TEST).save("n.caffemodel")


def nets() -> None:
    """Write a net with weights and an image, and an old net and solver."""
    readers.make_run_net()
    readers.put("old.prototxt", readers.OLD_NET)
    readers.put("solver.prototxt", 'net: "x" solver_type: ADAM base_lr: 0.1\n')


_REST = "make_recording rest --rate 20 --seconds 0.1 --camera 30,30,16,12 --force --out"
_TRACK = r"t\.(json|jsonl|csv|mp4|png)|t_right_0\.bvh"
COMMANDS = (
    Command("train solver.prototxt --log train.log", readers.make_solver, ("train.log",), r"train\.log"),
    Command("caffe train -solver solver.prototxt", lambda: readers.make_solver("BINARYPROTO")),
    Command("test n.caffemodel.h5 --model net.prototxt --picture hands.png", scored, ("hands.png",)),
    Command("predict crop.png --weights net.caffemodel.h5 --fit no --out d --html p.html --csv p.csv --json p.json",
            crop, ("p.html", "p.csv", "p.json", "d/crop_hand.png")),
    Command("track frames --json t.json --csv t.csv --bvh t.bvh --video t.mp4 --sheet t.png", frames,
            ("t.json", "t.csv", "t.mp4", "t.png", "t_right_0.bvh"), _TRACK),
    Command("track frames --json t.jsonl --udp 127.0.0.1:9", frames, ("t.jsonl",), _TRACK),
    Command("track frames --look look.png", frames, ("look.png",)),
    Command("record frames --force --out new", frames, (), r"new.*"),
    Command("record frames --force --out new --out-unit 1", old_recording),
    Command("record frames --force --out new.npz", frames, ("new.npz",)),
    Command("record frames --force --out new.mkv", frames, ("new.mkv",), r"new\.mkv"),
    Command(f"{_REST} made", files=("made.truth.json",), parts="made.*"),
    Command(f"{_REST} made.npz", files=("made.npz", "made.truth.json"), parts=r"made\.truth\.json"),
    Command("make_synthetic --out data --train 4 --test 2 --workers 1"),
    Command("make_synthetic --out data --train 4 --test 2 --workers 1 --seed 4 --force", data, (), r"data/\w+\.txt"),
    Command("make_synthetic --raw --out raw --train 2 --test 1 --workers 1"),
    Command("make_synthetic --places --out places --train 2 --test 1 --workers 1"),
    Command("upgrade_net old.prototxt new.prototxt", nets, ("new.prototxt",)),
    Command("upgrade_net --solver solver.prototxt new.prototxt", nets, ("new.prototxt",)),
    Command("export_onnx net.prototxt net.caffemodel net.onnx", nets, ("net.onnx",)),
    Command("plot_log caffe.log --out curves.png", readers.make_logs, ("curves.png",)),
    Command("show_data data/test.txt --out some.png", data, ("some.png",)),
    Command("evaluate icvl --groundtruth truth.txt --predictions N=near.txt --plot plot.png", published, ("plot.png",)),
    Command("fit_pose xyz.txt --format xyz --out angles.h5", joints, ("angles.h5",)),
    Command("fit_pose data/test.txt --out angles", data),
    Command("calibrate_hand data/train_000.h5 --out me.prototxt --force", many, ("me.prototxt",)),
    Command("compute_image_mean db mean.binaryproto", database, ("mean.binaryproto",)),
    Command("convert_imageset ./ list.txt new_db --encoded", readers.make_pictures),
    Command("extract_features n.caffemodel net.prototxt y features 3 lmdb", features),
    Command("draw_net net.prototxt net.dot", nets, ("net.dot",)),
    Command("run_net net.prototxt net.caffemodel a.png --out blobs.npz", nets, ("blobs.npz",)),
    Command("run_net net.prototxt net.caffemodel a.png --out blob.npy", nets, ("blob.npy",)),
    Command("demo --out shown --frames 1", lambda: None, ("shown/hands.json",)),
    Command("exercise relu --start"),
)
NAMES = tuple(command.name for command in COMMANDS)


def _main(tool: str) -> Callable[[list[str]], int]:
    main: Callable[[list[str]], int] = importlib.import_module(f"tools.{tool}").main
    return main


# ---------------------------------------------------------------------------------------------- a run


@dataclass(frozen=True)
class Undisturbed:
    """A run without a fault.

    folder  the folder before it
    before  content of the files before it
    after   and after it
    calls   number of calls that can fail
    """

    command: Command
    folder: Path
    before: dict[str, Any]
    after: dict[str, Any]
    calls: int

    @functools.cached_property
    def outputs(self) -> list[str]:
        """Names of new files and folders, and of changed files."""
        return sorted(path for path, content in self.after.items() if self.before.get(path) != content)


Arm = Callable[[], "contextlib.AbstractContextManager[object]"]


@functools.cache
def undisturbed(name: str) -> Undisturbed:
    """Prepare a command and run it, once per process."""
    command = COMMANDS[NAMES.index(name)]
    folder = Path(f"before.{NAMES.index(name)}").resolve()
    folder.mkdir()
    with readers._inside(folder):
        runs.expect_good(*runs.forked(lambda: command.prepare() and None), f"preparing {name}")
        before = contents()
    calls = functools.partial(failing_calls, 0, 0, 0, False)
    with readers._copied(folder):
        ended = run(command, calls)
        if ended.status:
            raise BrokenPromise("BROKEN", f"{name} ends with {ended.status} without a fault: {ended.line}")
        for module in ended.modules:  # imported here once instead of in every child
            if module.startswith(("tools.", "handpose.", "scipy.", "matplotlib.", "av", "lmdb")):
                with contextlib.suppress(ImportError):
                    importlib.import_module(module)
        return Undisturbed(command, folder, before, contents(), ended.calls)


@dataclass(frozen=True)
class Ended:
    """How a command ended: its status, its last line on standard error, and what else it counted."""

    status: int
    line: str
    calls: int
    modules: list[str]


def run(command: Command, arm: Arm = contextlib.nullcontext) -> Ended:
    """Run a command in a forked process, under a fault."""

    def child() -> str:
        tool, *argv = command.line.split()
        main, errors = _main(tool), io.StringIO()
        with contextlib.redirect_stderr(errors), contextlib.redirect_stdout(io.StringIO()):
            try:
                with arm():
                    status = main(argv)
            except SystemExit as stopped:
                status = stopped.code  # type: ignore[assignment]
        lines = errors.getvalue().strip().splitlines()
        if found := [line for line in lines if line.startswith(("Traceback", "Exception ignored"))]:
            raise BrokenPromise("TRACEBACK", f"{found[0]} ... {lines[-1]}")
        calls = _library().failing_calls() if _library() else 0
        return json.dumps([status, lines[-1] if lines else "", calls, sorted(set(sys.modules) - known)])

    known = set(sys.modules)
    status, answer = runs.forked(child)
    runs.expect_good(status, answer, command.line)
    if not isinstance(answer, str):
        raise BrokenPromise("CRASH", f"{command.line}: status {status} without an answer")
    return Ended(*json.loads(answer))


def contents() -> dict[str, Any]:
    """What is in the working directory: by name, the content of a file, the target of a link, or "folder"."""
    found: dict[str, Any] = {}
    for path in Path().rglob("*"):
        if path.is_symlink():
            found[str(path)] = f"link to {path.readlink()}"
        elif path.is_file():
            found[str(path)] = content_of(path)
        else:
            found[str(path)] = "folder" if path.is_dir() else "no file"
    return found


def content_of(path: Path) -> Any:
    """The content of a file without what two equal runs write differently: times of day, random numbers of a format."""
    content = path.read_bytes()
    try:
        match path.suffix:
            case ".npz":
                with np.load(io.BytesIO(content)) as arrays:
                    return readers.digest({name: arrays[name] for name in arrays.files})
            case ".mkv":
                return readers.digest(readers.read_recording(path))
            case ".mat":
                return content[128:]  # after the date
            case _ if ".solverstate" in path.name:  # it has the times of the data files
                solver = netlib.get_solver("solver.prototxt")
                solver.restore(path)
                return readers.digest(readers.everything(solver))
            case ".log":
                return re.sub(rb"\d{4} [\d:.]+ +\d+|\([^)]*s/\d+ iters\)", b"", content)
    except Exception:  # of a damaged file
        return content
    return content


# ---------------------------------------------------------------------------------------------- the faults


@functools.cache
def _library() -> Any:
    """The functions of failing_calls.c; None if it is not loaded, for want of a compiler."""
    library = ctypes.CDLL(None)
    return library if hasattr(library, "fail_calls") else None


@contextlib.contextmanager
def failing_calls(first: int, last: int, error: int, shorten: bool) -> Iterator[None]:
    """Let calls fail within the block."""
    library = _library()
    if library is None:
        yield
        return
    library.fail_calls(os.fsencode(Path.cwd()), first, last, error, shorten)
    try:
        yield
    finally:
        library.fail_calls(b"", 0, 0, 0, 0)


ALL = 1 << 30
CALLS = {
    "fails with EIO": (0, errno.EIO, False), "fails with ENOSPC": (0, errno.ENOSPC, False),
    "is interrupted": (0, errno.EINTR, False), "is cut": (0, 0, True),
    "and all after it fail": (ALL, errno.ENOSPC, False), "is on a read-only disk": (ALL, errno.EROFS, False),
    "is cut, and all writes after it fail": (ALL, errno.ENOSPC, True),
}


@dataclass(frozen=True)
class Fault:
    """A fault: its description, a context manager under which the command runs, and the name that it takes, if any."""

    what: str
    arm: Arm
    taken: str = ""


def a_call(before: Undisturbed, rng: random.Random) -> Fault:
    """A failing call."""
    at, kind = 1 + rng.randrange(before.calls or 1), rng.choice(list(CALLS))
    more, error, shorten = CALLS[kind]
    return Fault(f"call {at} {kind}", functools.partial(failing_calls, at, at + more, error, shorten))


PRECIOUS = b"precious"
OBJECTS: dict[str, Callable[[Path, Path], object]] = {
    "a link": lambda path, file: path.symlink_to(file),
    "a hard link": lambda path, file: os.link(file, path),
    "a link to nothing": lambda path, file: path.symlink_to(file.with_name("nothing")),
    "a link to itself": lambda path, file: path.symlink_to(path.name),
    "a folder": lambda path, file: path.mkdir(),
    "a folder with a file": lambda path, file: (path.mkdir(), shutil.copy(file, path / "mine")),
    "a pipe": lambda path, file: os.mkfifo(path),
    "a full device": lambda path, file: path.symlink_to("/dev/full"),
}


def an_object(before: Undisturbed, rng: random.Random) -> Fault:
    """Something else in the place of an output or lock."""
    locks = [".s.netlib.lock"] if "rows.h5" in before.before else []
    name, kind = rng.choice([*before.outputs, *locks]), rng.choice(list(OBJECTS))

    @contextlib.contextmanager
    def planted() -> Iterator[None]:
        path, outside = Path(name), Path("..", f"{Path.cwd().name}.outside").resolve()
        outside.mkdir()
        (outside / "file").write_bytes(PRECIOUS)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.unlink(missing_ok=True)
        OBJECTS[kind](path, outside / "file")
        own = path.lstat()
        yield
        changed = {found.name: found.read_bytes() for found in outside.iterdir()} != {"file": PRECIOUS}
        lost = kind == "a folder with a file" and not (path / "mine").exists()
        shutil.rmtree(outside)
        if os.path.lexists(path) and os.path.samestat(own, path.lstat()):  # it was not replaced
            (path / "mine").unlink(missing_ok=True) if path.is_dir() else path.unlink()
            if path.is_dir() and not any(Path(path).iterdir()):
                path.rmdir()
        if changed or lost:
            raise BrokenPromise("LOST", "another file was written" if changed else "a file was removed")

    return Fault(f"{kind} as {name}", planted, name)


def a_limit(before: Undisturbed, rng: random.Random) -> Fault:
    """A limit of the process."""
    largest = max((len(content) for content in before.after.values()), default=0)
    kind, most = rng.choice(((resource.RLIMIT_FSIZE, largest), (resource.RLIMIT_NOFILE, 12), (resource.RLIMIT_AS, 256)))
    more = rng.choice((0, rng.randrange(most + 1), rng.randrange(most + 1)))
    if kind == resource.RLIMIT_AS:  # with less, OpenBLAS and OpenCV crash, and Python waits for threads without a stack
        more += 32

    @contextlib.contextmanager
    def limited() -> Iterator[None]:
        most = more
        if kind == resource.RLIMIT_NOFILE:
            used = {int(file.name) for file in Path("/proc/self/fd").iterdir()}
            most = next(itertools.islice((number for number in itertools.count() if number not in used), more, None))
        if kind == resource.RLIMIT_AS:
            pages = int(Path("/proc/self/statm").read_text().split()[0])
            most = pages * resource.getpagesize() + (more << 20)
        soft, hard = resource.getrlimit(kind)
        resource.setrlimit(kind, (most, hard))
        try:
            yield
        finally:
            resource.setrlimit(kind, (soft, hard))

    words = {resource.RLIMIT_FSIZE: "bytes of a file", resource.RLIMIT_NOFILE: "more descriptors",
             resource.RLIMIT_AS: "MB more of memory"}
    return Fault(f"{more} {words[kind]}", limited)


def a_clock(before: Undisturbed, rng: random.Random) -> Fault:
    """Clocks that a call moves by any step."""
    step = rng.choice((0.0, -1.0, -1e6, 1e9, rng.uniform(-10, 10)))

    @contextlib.contextmanager
    def moved() -> Iterator[None]:
        now = 1e9

        def tick() -> float:
            nonlocal now
            now = min(max(now + step, 0), 1e11)
            return now

        for name in ("time", "perf_counter", "monotonic"):
            setattr(time, name, tick)  # only of this forked process
        yield

    return Fault(f"a clock that goes by {step:g} s", moved)


FAULTS = (a_call, an_object, a_limit, a_clock)

# ---------------------------------------------------------------------------------------------- a case


def case(name: str, seed: int, number: int) -> Outcome:
    """Run a command under a fault, check what it leaves, and run it again."""
    before = undisturbed(name)
    rng = random.Random(f"{name} {seed} {number}")
    fault = FAULTS[number % len(FAULTS)](before, rng)
    with readers._copied(before.folder):
        if not fault.taken and rng.random() < 0.5:
            for file in before.command.files:
                Path(file).parent.mkdir(exist_ok=True)
                Path(file).write_bytes(b"old\n")
        there = contents()
        try:
            judge(before, there, run(before.command, fault.arm), fault)
            _restore(before)
            again = run(before.command)
            if again.status:
                raise BrokenPromise("LOST", f"the next run ends with {again.status}: {again.line}")
            if wrong := [path for path, content in contents().items() if content != before.after.get(path)]:
                raise BrokenPromise("LEFT", f"after the next run {wrong[0]} is not as without the fault")
        except BrokenPromise as broken:
            raise BrokenPromise(broken.kind, f"{fault.what}: {broken}") from None
    return Outcome("held")


def judge(before: Undisturbed, there: dict[str, Any], ended: Ended, fault: Fault) -> None:
    """Check the status, the message and the files of a run; ``there`` were the files before it."""
    if ended.status not in (0, 1, 2, 130):
        raise BrokenPromise("UNCLEAR", f"status {ended.status}: {ended.line}")
    names = {Path(word).name for word in [*before.after, *before.command.line.split()]} | {"snapshots there"}
    if "memory" in fault.what:
        names = {":", "not enough memory"}
    if ended.status and not (ended.line.isprintable() and any(name in ended.line for name in names)):
        raise BrokenPromise("UNCLEAR", f"does not name a file: {ended.line!r}")
    now = contents()
    allowed = re.compile(before.command.parts)
    for path, content in now.items():
        if content in (there.get(path), before.after.get(path)) or ".netlib." in path:
            continue
        if not (allowed.fullmatch(path) and _is_whole(Path(path))):
            raise BrokenPromise("LOST", f"{path} is neither the old file nor the new one (status {ended.status})")
    is_new = all(now.get(path) == content for path, content in before.after.items())
    for path in there:
        gone = path not in now and path != fault.taken
        if gone and not allowed.fullmatch(path) and not (is_new and path not in before.after):
            raise BrokenPromise("LOST", f"{path} is missing (status {ended.status})")
    if not ended.status:
        for path, content in before.after.items():
            if now.get(path) != content and not allowed.fullmatch(path):
                raise BrokenPromise("SILENT", f"status 0, but {path} is not as without the fault")


def _is_whole(path: Path) -> bool:
    """Whether a file ends with a whole line, or can be read."""
    content = path.read_bytes() if path.is_file() else b""
    try:
        match path.suffix:
            case ".json":
                json.loads(content)
            case ".png":
                return cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED) is not None
            case ".mp4" | ".mkv":
                import av

                with av.open(str(path)) as video:
                    return any(True for _ in video.decode(video=0))
            case _:
                return content.endswith(b"\n") or not content
    except Exception:  # of any reader
        return False
    return True


def _restore(before: Undisturbed) -> None:
    """Restore the files of before the run, but keep temporary files, which the next run must remove."""
    for path in sorted(set(contents()) - set(before.before), reverse=True):
        if ".netlib." in path:
            continue
        if not Path(path).is_dir():
            Path(path).unlink()
        elif not any(Path(path).iterdir()):
            Path(path).rmdir()
    now = contents()
    for path, content in before.before.items():
        if now.get(path) != content:
            Path(path).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(before.folder / path, path)
