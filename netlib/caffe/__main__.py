"""Run a script written for pycaffe unchanged, as Python runs it:

python -m netlib.caffe SCRIPT [ARGUMENT ...]
python -m netlib.caffe - [ARGUMENT ...]           the script on standard input; also without
                                                  -, from a pipe
python -m netlib.caffe -c CODE [ARGUMENT ...]
python -m netlib.caffe -m MODULE [ARGUMENT ...]
"""

from __future__ import annotations

import runpy
import sys
from pathlib import Path
from types import ModuleType

from netlib import install_as_caffe
from netlib.building.python_layer import python_2_advice


def _run(source: bytes | str, name: str, **known: str) -> None:
    """Run a text, which may declare its encoding, as the main module, in which these names
    are ``known``.
    """
    sys.modules["__main__"] = module = ModuleType("__main__")
    vars(module).update(known)
    try:
        exec(compile(source, name, "exec", dont_inherit=True), vars(module))  # noqa: S102 - the user's own script
    except (ImportError, SyntaxError) as error:
        if not (advice := python_2_advice(error)):
            raise
        sys.exit(f"{error}{advice}")


def main() -> None:
    """Run what the command line names, with netlib.caffe importable as ``caffe``."""
    words = sys.argv[1:] or ([] if sys.stdin is None or sys.stdin.isatty() else ["-"])
    if not words or words[0] in ("-h", "--help"):
        print(__doc__.strip())
        sys.exit(0 if words else 2)
    what, *rest = words
    if what in ("-c", "-m") and not rest:
        print(f"{what} needs {'code' if what == '-c' else 'the name of a module'}", file=sys.stderr)
        sys.exit(2)
    install_as_caffe()
    sys.path[0] = ""  # the working folder, as for Python's own -, -c and -m
    if what == "-c":
        sys.argv = ["-c", *rest[1:]]
        _run(rest[0], "<string>")
    elif what == "-m":
        sys.argv = rest
        runpy.run_module(rest[0], run_name="__main__", alter_sys=True)
    elif what == "-":
        sys.argv = words
        _run(sys.stdin.buffer.read(), "<stdin>")
    else:
        path = Path(what)
        if not path.exists() or path.is_dir():
            sys.exit(f"{what}: script not found")
        sys.argv = words
        sys.path[0] = str(path.resolve().parent)  # as when Python runs the script
        _run(path.read_bytes(), what, __file__=what)


if __name__ == "__main__":
    main()
