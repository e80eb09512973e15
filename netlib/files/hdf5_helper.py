"""The helper process that checks HDF5 files (hdf5_check.py). Started for the first file, it ends with this process.

It takes 0.2 s to start and some milliseconds per file. Results are cached until the file changes.
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

from netlib.errors import reason_of, warn_once
from netlib.files import Identity
from netlib.system.one_thread import call_after_fork

SECONDS, BYTES_PER_SECOND = 10.0, 20e6  # time limit of a check: SECONDS plus the size of the file / BYTES_PER_SECOND
CHECK = Path(__file__).with_name("hdf5_check.py")


@functools.lru_cache(maxsize=4096)
def fault_of(path: str, content: Identity) -> str:
    """Describe what is wrong with an HDF5 file by a phrase that follows its name; empty if nothing is."""
    seconds = SECONDS + content[2] / BYTES_PER_SECOND
    with _state.lock:
        helper = _state.running()
        if helper is None:
            return ""
        try:
            answer = helper.ask(str(Path(path).absolute()), seconds)
        except BaseException:  # Ctrl-C: the pending answer would be read as the answer to the next question
            _state.end()
            raise
        if answer is None:
            _state.helper = None
            return f"damaged: the HDF5 library {helper.end()}"
        return answer


class _Helper:
    """A running helper process. Raises OSError if it cannot be started."""

    def __init__(self) -> None:
        folders = {str(Path(str(module.__file__)).parent.parent) for module in (h5py, np)}
        self._process = subprocess.Popen(
            [sys.executable, "-I", str(CHECK), *sorted(folders)], encoding="ascii", stderr=subprocess.DEVNULL,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            start_new_session=True,  # else Ctrl-C would kill it, which looks like a crash on this file
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._in, self._out = self._process.stdin, self._process.stdout
        self._late = threading.Event()
        if not self._out.readline():  # the ready line
            self.end()
            raise OSError("it does not start")

    def ask(self, path: str, seconds: float) -> str | None:
        """Check a file. Returns None if the process ended without an answer."""
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
        """Whether the process is running; the system may have killed it when memory ran out."""
        return self._process.poll() is None

    def kill(self) -> None:
        """Kill the process. It does not end while a forked process holds the other end of its pipe."""
        self._process.kill()

    def end(self) -> str:
        """Wait for the process to end and describe how it ended."""
        for stream in (self._in, self._out):
            with contextlib.suppress(OSError):
                stream.close()
        status = self._process.wait()
        return "does not finish reading it" if self._late.is_set() else f"crashes on it (status {status})"


class _State:
    """The helper of this process, if any."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.helper: _Helper | None = None
        self.of_parents: list[_Helper | None] = []  # referenced so that a child process does not end them

    def running(self) -> _Helper | None:
        """Return the helper, starting it if necessary; None, with a warning, if it cannot be started."""
        if self.helper is not None and not self.helper.lives():
            self.end()
        if self.helper is None:
            try:
                self.helper = _Helper()
            except OSError as error:
                warn_once(f"HDF5 files are opened unchecked: cannot start the helper process ({reason_of(error)})")
        return self.helper

    def after_fork(self) -> None:
        """Make a child process start its own helper."""
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
call_after_fork(_state)
