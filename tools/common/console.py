"""Conventions of all tools: exit statuses, one-line errors and their advice, tables, durations."""

from __future__ import annotations

import argparse
import errno
import os
import sys
from collections.abc import Callable, Sequence
from typing import TextIO

import tools
from netlib.building import python_layer
from netlib.errors import NetlibError, printable, reason_of
from netlib.system import memory
from tools.common.commands import command

DONE, FAILED = 0, 1  # argparse exits with 2 for wrong usage


def guarded(run: Callable[[argparse.Namespace], int | None], args: argparse.Namespace) -> int:
    """Run a tool; returns the exit status, which is 0 if ``run`` returns none.

    A user's mistake gives one line on stderr and exit status 1, never a traceback.
    """
    try:
        with (
            tools.interruptible(),
            python_layer.allowed(not getattr(args, "no_python_layers", False)),
        ):
            return run(args) or DONE
    except NetlibError as error:
        print(_with_advice(error), file=sys.stderr)
    except UnicodeEncodeError as error:
        notify(
            f"cannot print or write {error.object[error.start : error.end]!r} in the encoding {error.encoding}; "
            "set PYTHONUTF8=1"
        )
    except ImportError as error:  # also of a library for which memory or descriptors do not suffice
        notify(f"cannot load {error.name or 'a package'}: {reason_of(error)}")
    except BrokenPipeError:  # the reader of the output has ended, like ``head``
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        if error.errno == errno.ENOENT and not error.filename:  # os.getcwd names no file
            notify("the working directory was deleted; change to another one")
        else:
            notify(f"{error.filename or 'standard output'}: {reason_of(error)}")
    except KeyboardInterrupt:
        notify("interrupted")
        return 130
    except Exception as error:
        if memory.is_lacking(error):
            notify("not enough memory; use a smaller batch_size")
        elif isinstance(error, RuntimeError) and "start new thread" in str(error):
            notify("cannot start a thread: too many, or not enough memory; use fewer --threads")
        else:
            raise
    return FAILED


def _with_advice(error: NetlibError) -> str:
    text = str(error)
    if "cannot read the list" in text and "data/nyu" in text:
        return (
            f"{text}; generate synthetic hands with '{command('make_synthetic')}', or read the NYU data set with "
            f"'{command('prepare_nyu')} NYU_ROOT'"
        )
    return text


def say(*words: object, sep: str = " ", file: TextIO | None = None) -> None:
    """Print a line, with unprintable characters escaped, so that names cannot
    start another line.
    """
    print(*map(printable, words), sep=sep, file=file)


def notify(*words: object) -> None:
    """Print a line that is no result, such as a warning, on standard error."""
    say(*words, file=sys.stderr)


def aligned(rows: Sequence[Sequence[str]]) -> str:
    """Format rows of cells as a table with the first column left-aligned and the others
    right-aligned.
    """
    rows = [[printable(cell) for cell in row] for row in rows]
    widths = [max(len(cell) for cell in column) for column in zip(*rows)]
    aligns = [str.ljust, *[str.rjust] * (len(widths) - 1)]
    lines = [
        [align(cell, width) for align, cell, width in zip(aligns, row, widths)] for row in rows
    ]
    return "\n".join(map("  ".join, lines))


def duration(seconds: float) -> str:
    """Format seconds: ``75`` → ``1 min 15 s``."""
    minutes, rest = divmod(round(max(seconds, 0.0)), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
