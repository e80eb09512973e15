"""Read variables of a MATLAB file of version 5 in a separate program: on a damaged file SciPy's reader may crash.

    python -I matlab_worker.py FILE NAME,NAME... FOLDER...

writes lines of JSON to standard output: ``{"variables": [...]}``, the file's variables; for each existing NAME
``{"name": ...}``, and the array in NumPy's format; or ``{"fault": "..."}``. Of an array of four axes only the first
item: NYU's has three cameras, and is large. FOLDERs hold the packages NumPy and SciPy.
"""

from __future__ import annotations

import io
import json
import sys
from collections.abc import Sequence
from typing import BinaryIO

if __name__ == "__main__":
    sys.path += sys.argv[3:]

import numpy as np
import scipy.io

DAMAGED = "not a readable MATLAB file, perhaps truncated"


def main(path: str, names: Sequence[str], out: BinaryIO) -> None:
    """Write the variables to ``out``."""
    try:
        if scipy.io.matlab.matfile_version(path)[0] == 0:
            _line(out, {"fault": "a MATLAB file of version 4, or none; expected version 5 or 7.3"})
            return
        there = [name for name, _, _ in scipy.io.whosmat(path)]
        _line(out, {"variables": there})
        for name in names:
            if name in there:
                array = scipy.io.loadmat(path, variable_names=[name])[name]
                if array.dtype.kind not in "fiuU":
                    _line(out, {"fault": f"{name} is {array.dtype} of shape {array.shape}, expected numbers"})
                    return
                _line(out, {"name": name})
                image = io.BytesIO()  # NumPy would write past the buffer of a pipe
                np.save(image, array[:1] if array.ndim == 4 else array, allow_pickle=False)
                out.write(image.getbuffer())
        out.flush()
    except (OSError, MemoryError) as error:
        system = isinstance(error, MemoryError) or error.errno
        _line(out, {"fault": f"{'cannot be read' if system else DAMAGED}: {_reason(error)}"})
    except Exception as error:  # for a damaged file SciPy's reader may raise any exception
        _line(out, {"fault": f"{DAMAGED}: {_reason(error)}"})


def _reason(error: BaseException) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__


def _line(out: BinaryIO, header: dict[str, object]) -> None:
    out.write(json.dumps(header).encode() + b"\n")
    out.flush()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2].split(","), sys.stdout.buffer)
