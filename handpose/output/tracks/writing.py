"""Writers of tracks, by the ending of a name.

with open_writer("wave.json", header) as writer:
    for frame in frames:
        writer.write(frame)
"""

from __future__ import annotations

from pathlib import Path

from handpose.body.joint_formats.formats import FormatName
from handpose.output.tracks.growing import TrackWriter
from handpose.output.tracks.json_file import JsonLinesWriter, JsonWriter
from handpose.tracking.track import TrackHeader
from netlib.errors import DataError


def open_writer(
    path: str | Path, header: TrackHeader, joints: FormatName | None = None, gestures: bool = False
) -> TrackWriter:
    """A writer for a name in .json, .jsonl or .csv, or for "-": JSON lines on standard output. Raises DataError.

    joints    format of additional joints and angles in JSON, and of the joints in CSV
    gestures  add the gesture of each hand to JSON and CSV
    """
    if str(path) == "-":
        return JsonLinesWriter(None, header, joints, gestures)
    path = Path(path)
    match path.suffix.lower():
        case ".json":
            return JsonWriter(path, header, joints, gestures)
        case ".jsonl":
            return JsonLinesWriter(path, header, joints, gestures)
        case ".csv":
            from handpose.output.tracks.csv_file import CsvWriter

            return CsvWriter(path, header, joints, gestures)
    raise DataError(f"{path}: cannot write a track of this kind; expected a name in .json, .jsonl or .csv, or - "
                    "for standard output")
