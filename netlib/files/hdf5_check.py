"""Check whether an HDF5 file is safe to open. Runs as a separate process, because the HDF5 library can crash or hang.

    {"ready": true}                  on standard output, once questions are accepted
    {"path": ..., "seconds": ...}    on standard input, one line per file, with the time limit of the check
    {"fault": "..."}                 on standard output, the answer: what is wrong, empty if nothing

The arguments are the folders of the packages that it needs, h5py and NumPy.

It checks everything that a reader might access: every link, every attribute, and where and how the values of every data
set are stored. Values that are not plain contiguous numbers are read, up to a limit. The parent
(netlib/files/hdf5_helper.py) kills this process if an answer takes too long.

It rejects external links, external storage and virtual data sets, filters that need a plug-in, and data sets that claim
values which the file does not contain. It imports nothing else of this project, to start fast.
"""

from __future__ import annotations

import json
import math
import re
import signal
import sys

sys.path += sys.argv[1:]

import h5py

MEMORY = 4 << 30  # limit of the process in bytes
READ = 1 << 28  # limit in bytes of compressed or variable-length values that are read
LARGE = 1 << 26  # data sets of at least this many bytes must be stored
SYSTEM = re.compile(r"\berrno = (5|12|13|23|24)\b")  # EIO, ENOMEM, EACCES, ENFILE, EMFILE in HDF5's messages
FILTERS = {1: "gzip", 2: "shuffle", 3: "fletcher32", 32000: "lzf"}  # part of h5py and known to fail cleanly


class FaultError(Exception):
    """A fault of a file, described by a phrase that follows its name."""


def fault_of(path: str) -> str:
    """Describe what is wrong with a file; empty if nothing is."""
    try:
        with h5py.File(path, "r", locking=False) as file:
            _Walk().group(file)
    except FaultError as error:
        return str(error)
    except MemoryError:
        return f"its check needs more than {MEMORY >> 30} GB of memory"
    except Exception as error:  # the library can raise anything on a damaged file
        text = " ".join(str(error).split()) or type(error).__name__
        return text if isinstance(error, OSError) and SYSTEM.search(text) else f"damaged or truncated: {text}"
    return ""


class _Walk:
    """Visits every object of a file once."""

    def __init__(self) -> None:
        self.seen: set[object] = set()
        self.left = READ

    def group(self, top: h5py.Group) -> None:
        """Check a group and everything below it."""
        waiting = [top]
        while waiting:
            group = waiting.pop()
            self.attributes(group)
            for name in _names(group):
                link = group.get(name, getlink=True)
                where = f"{group.name.rstrip('/')}/{name}"
                if isinstance(link, h5py.ExternalLink):
                    raise FaultError(f"{where!r} is a link into another file, {link.filename!r}, which is not "
                                     "followed; expected all in one file")
                if isinstance(link, h5py.SoftLink):  # its target is checked where it is stored
                    continue
                if not isinstance(link, h5py.HardLink):
                    raise FaultError(f"{where!r} is a link of an unknown kind")
                item = group[name]
                key = h5py.h5o.get_info(item.id).addr
                if key in self.seen:
                    continue
                self.seen.add(key)
                if isinstance(item, h5py.Group):
                    waiting.append(item)
                elif isinstance(item, h5py.Dataset):
                    self.attributes(item)
                    self.dataset(item)

    def attributes(self, item: h5py.Group | h5py.Dataset) -> None:
        """Read all attributes."""
        for name in _names(item.attrs):
            value = item.attrs[name]
            self.spend(getattr(value, "nbytes", 0), f"attribute {name!r}")

    def dataset(self, dataset: h5py.Dataset) -> None:
        """Check that the values are in this file, complete and readable."""
        where = f"data set {dataset.name!r}"
        if dataset.is_virtual:
            raise FaultError(f"{where} is virtual and refers to other data sets, which are not read; expected values")
        if dataset.external:
            raise FaultError(f"{where} is kept in another file, {dataset.external[0][0]!r}, which is not read; "
                             "expected all in one file")
        plist = dataset.id.get_create_plist()
        for i in range(plist.get_nfilters()):
            number, _, _, name = plist.get_filter(i)
            if number not in FILTERS:
                raise FaultError(f"{where} is compressed by filter {number} ({name.decode(errors='replace')}), which "
                                 "is not supported; expected gzip, or none")
        stored = dataset.id.get_storage_size()
        claimed = math.prod(dataset.shape or ()) * dataset.id.get_type().get_size()
        if claimed >= LARGE and claimed > 2000 * stored:  # beyond the compression ratio of gzip, about 1000
            raise FaultError(f"{where} claims {claimed} bytes, but only {stored} are stored; expected data")
        in_one_piece = dataset.id.get_offset() is not None
        if in_one_piece and dataset.dtype.kind in "fiuSb":
            if claimed > stored:
                raise FaultError(f"{where} claims {claimed} bytes, but only {stored} are stored; expected data")
        elif self.left >= claimed:
            self.spend(claimed, where)
            dataset[()]

    def spend(self, count: int, what: str) -> None:
        """Count bytes read. Raises FaultError beyond the limit."""
        self.left -= count
        if self.left < 0:
            raise FaultError(f"{what} is too large")


def _names(group: h5py.Group) -> list[str]:
    try:
        return list(group)
    except UnicodeDecodeError:
        raise FaultError(f"a name in {getattr(group, 'name', 'it')!r} is not UTF-8; expected names in UTF-8") from None


def main() -> None:
    """Answer questions until the input ends."""
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    except (ImportError, OSError, ValueError):  # limits are not supported everywhere
        pass
    print(json.dumps({"ready": True}), flush=True)
    for line in sys.stdin:
        question = json.loads(line)
        _end_after(2 * question["seconds"])
        fault = fault_of(question["path"])
        _end_after(0)
        print(json.dumps({"fault": fault}), flush=True)


def _end_after(seconds: float) -> None:
    """End this process after some seconds in case the parent was killed; 0 cancels this."""
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, seconds)


if __name__ == "__main__":
    main()
