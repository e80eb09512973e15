"""Variables of a MATLAB file of version 5, read in a separate process (matlab_worker.py): a bad file may crash it."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from netlib.errors import DataError, reason_of

WORKER = Path(__file__).with_name("matlab_worker.py")
SECONDS, BYTES_PER_SECOND = 60.0, 5e6  # time limit: 60 s and 1 s per 5 MB


def read_variables(path: Path, names: Sequence[str], optional: Sequence[str] = ()) -> dict[str, Any]:
    """The arrays, of those with four axes the first item; ``optional`` ones if they exist.

    Raises DataError.
    """
    stream, arrays = io.BytesIO(_run_worker(path, [*names, *optional])), {}
    while line := stream.readline():
        header = json.loads(line)
        if "fault" in header:
            raise DataError(f"{path}: {header['fault']}")
        if "variables" in header and (missing := [name for name in names if name not in header["variables"]]):
            there = ", ".join(sorted(header["variables"])) or "none"
            raise DataError(f"{path}: no variable {missing[0]!r}; it has {there}")
        if "name" in header:
            arrays[header["name"]] = np.lib.format.read_array(stream, allow_pickle=False)
    return arrays


def _run_worker(path: Path, names: Sequence[str]) -> bytes:
    """The output of matlab_worker.py for these variables of the file. Raises DataError if it fails."""
    folders = sorted({str(Path(str(module.__file__)).parent.parent) for module in (np, scipy)})
    command = [sys.executable, "-I", str(WORKER), str(path.absolute()), ",".join(names), *folders]
    limit = SECONDS + path.stat().st_size / BYTES_PER_SECOND
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    try:
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, timeout=limit, check=False,
                              env=environment)
    except subprocess.TimeoutExpired:
        raise DataError(f"{path}: damaged: SciPy's reader does not come to an end with it") from None
    except OSError as error:
        raise DataError(f"{path}: cannot be read: no process can be started: {reason_of(error)}") from None
    if done.returncode == -signal.SIGKILL:
        raise DataError(f"{path}: cannot be read: the process that reads it was killed, perhaps for lack of memory")
    if done.returncode:
        raise DataError(f"{path}: damaged: SciPy's reader crashes on it (status {done.returncode})")
    return done.stdout
