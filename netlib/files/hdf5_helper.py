"""The helper process that looks at HDF5 files (hdf5_check.py): started at the first file, ended with this process.

It costs 0.2 s once, and some milliseconds for each file; what it said of a file that has not changed is remembered.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import h5py
import numpy as np

from netlib.errors import reason_of
from netlib.files import Identity
from netlib.system.once import once
from netlib.system.one_thread import tell

SECONDS, BYTES_PER_SECOND = 10.0, 20e6  # that a look may take: so many, and one more for so many bytes of the file
CHECK = Path(__file__).with_name("hdf5_check.py")


@functools.lru_cache(maxsize=4096)
def fault_of(path: str, content: Identity) -> str:
    """What is wrong with an HDF5 file, in words that follow its name; empty if nothing."""
    seconds = SECONDS + content[2] / BYTES_PER_SECOND
    with _state.lock:
        helper = _state.running()
        if helper is None:
            return ""
        try:
            answer = helper.ask(str(Path(path).absolute()), seconds)
        except BaseException:  # Ctrl-C: its answer would be taken for the one to the next question
            _state.end()
            raise
        if answer is None:
            _state.helper = None
            return f"damaged: the HDF5 library {helper.end()}"
        return answer


class _Helper:
    """The process. Raises OSError if it cannot be started."""

    def __init__(self) -> None:
        folders = {str(Path(str(module.__file__)).parent.parent) for module in (h5py, np)}
        self._process = subprocess.Popen(
            [sys.executable, "-I", str(CHECK), *sorted(folders)], encoding="ascii", stderr=subprocess.DEVNULL,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            start_new_session=True,  # a terminal's signals are for us: Ctrl-C would look like a file that crashes it
        )  # fmt: skip
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._in, self._out = self._process.stdin, self._process.stdout
        self._late = threading.Event()
        if not self._out.readline():  # it says when it is there
            self.end()
            raise OSError("it does not start")

    def ask(self, path: str, seconds: float) -> str | None:
        """What is wrong with a file; None if the process did not live to tell."""
        watch = threading.Timer(seconds, self._give_up)
        watch.start()
        try:
            self._in.write(json.dumps({"path": path, "seconds": seconds}) + "\n")
            self._in.flush()
            answer = self._out.readline()
        except BrokenPipeError:
            answer = ""
        finally:
            watch.cancel()
        return str(json.loads(answer)["fault"]) if answer else None

    def _give_up(self) -> None:
        self._late.set()
        self.kill()

    def lives(self) -> bool:
        """Can it still be asked? Not if somebody has killed it, as a system does that lacks memory."""
        return self._process.poll() is None

    def kill(self) -> None:
        """Have it end at once. It would end by itself, but not as long as a forked process has our end of its pipe."""
        self._process.kill()

    def end(self) -> str:
        """Wait for the end of the process; how it ended, in words."""
        for stream in (self._in, self._out):
            with contextlib.suppress(OSError):
                stream.close()
        status = self._process.wait()
        return "does not come to an end with it" if self._late.is_set() else f"crashes on it (status {status})"


class _State:
    """The helper of this process, if it has one."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.helper: _Helper | None = None
        self.of_parents: list[_Helper | None] = []  # kept, because they are not for this process to end

    def running(self) -> _Helper | None:
        """The helper, started if need be; None, and a note, where no process can be started."""
        if self.helper is not None and not self.helper.lives():
            self.end()
        if self.helper is None:
            try:
                self.helper = _Helper()
            except OSError as error:
                once(f"HDF5 files are opened without a look from outside: no helper process ({reason_of(error)})")
        return self.helper

    def after_fork(self) -> None:
        """A child has a helper of its own."""
        self.of_parents.append(self.helper)
        self.lock, self.helper = threading.Lock(), None

    def end(self) -> None:
        """End the helper."""
        if self.helper is not None:
            self.helper.kill()
            self.helper.end()
            self.helper = None


_state = _State()
atexit.register(_state.end)
tell(_state)
