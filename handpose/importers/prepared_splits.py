"""A published split in the files that nets read: its parts, their list, and a list of bad frames."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from handpose.data import parts as files
from handpose.data.images import BadFrameError
from handpose.importers.preparation import Outcome, is_current, parts_of, write_parts
from handpose.importers.published_frames import PublishedFrames, statistics
from netlib.errors import DataError, printable
from netlib.files import atomic


class PreparedSplit:
    """One split in a folder.

    frames   to prepare
    parts    the HDF5 files; ``missing`` are those to be written, all if ``force``
    list     the text file that names them: SPLIT.txt
    bad      the text file that names the bad frames, if there are any: bad_SPLIT.txt
    """

    def __init__(self, frames: PublishedFrames, out: Path, force: bool = False) -> None:
        self.frames = frames
        self.parts = parts_of(frames, out)
        self.missing = [part for part in self.parts if force or not is_current(frames, part)]
        self.list, self.bad = out / f"{frames.split}.txt", out / f"bad_{frames.split}.txt"

    def write(
        self, workers: int, advance: Callable[[int], None], on_bad: Callable[[int, BadFrameError], None]
    ) -> Outcome:
        """Write the missing parts, and name the bad frames; arguments as for ``write_parts``."""
        named: list[str] = []

        def name(i: int, error: BadFrameError) -> None:
            on_bad(i, error)
            named.append(f"frame {i}: {error}\n")

        if self.missing:
            self.list.unlink(missing_ok=True)  # no list may name files of two kinds
        outcome = write_parts(self.frames, self.parts, self.missing, workers, advance, name)
        if named:
            atomic.replace_text(self.bad, "".join(named))
        else:
            self.bad.unlink(missing_ok=True)
        return outcome

    def write_list(self, outcome: Outcome) -> None:
        """Write the list of the parts that have frames. Raises DataError if none has."""
        if not outcome.index:
            folder, split = self.frames.files[0].parent, self.frames.split
            raise DataError(f"{folder}: none of the {len(self.frames)} {split} frames can be used")
        used = {i // files.FRAMES_PER_FILE for i in outcome.index}
        some = [part.path for n, part in enumerate(self.parts) if n in used]  # HDF5Data rejects files without rows
        atomic.replace_text(self.list, files.list_text(some))

    def report(self, outcome: Outcome) -> str:
        """The result of the preparation, in two lines."""
        counts = ", ".join(f"{count} {kind}" for kind, count in sorted(Counter(outcome.bad.values()).items()))
        bad = f", {len(outcome.bad)} bad frames left out: {counts}" if counts else ", none bad"
        split = self.frames.split
        head = f"{split}: {len(outcome.index)} frames ({printable(self.frames.made_from)}){bad}"
        return f"{head}\n{split}: {statistics(self.frames, outcome.index)}"


def refuse_foreign(splits: Sequence[PreparedSplit], own: Sequence[str], force: bool = False) -> None:
    """Raise DataError if a file to be replaced holds data of an origin that is not in ``own``.

    With ``force`` only folders and devices raise.
    """
    every = [part.path for split in splits for part in split.parts]
    files.refuse_foreign(every, [split.list for split in splits], own, force)
