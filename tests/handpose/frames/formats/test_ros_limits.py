"""Bags that would block a reader or exhaust its memory."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from handpose.frames.cameras import Camera
from handpose.frames.formats import ros_limits
from handpose.frames.recording import CameraInfo
from netlib.errors import DataError
from tests.support import bags

pytest.importorskip("rosbags", reason="rosbags is missing: pip install rosbags")

from handpose.frames.formats.ros_bag import open_bag

GIVEN = CameraInfo(Camera("own", 60, 60, 32, 24, 64, 48))
DEPTH = np.random.default_rng(0).integers(0, 4000, (2, 48, 64)).astype(np.uint16)


@pytest.mark.parametrize("name", ["a.bag", "a.db3", "a.mcap"])
def test_a_huge_file_of_nothing(tmp_path: Path, name: str) -> None:
    """The reader does not search a huge file for the end of its first line."""
    (tmp_path / name).touch()
    os.truncate(tmp_path / name, 1 << 40)
    with pytest.raises(DataError, match=f"{name}: cannot read the bag: it does not begin with"):
        open_bag(tmp_path / name, GIVEN)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
@pytest.mark.parametrize("name", ["ros2.db3", "metadata.yaml", "b.db3.zstd"])
def test_a_pipe_in_a_folder(tmp_path: Path, name: str) -> None:
    """A pipe in the folder raises an error instead of blocking."""
    folder = bags.write_ros2(tmp_path / "ros2", DEPTH)
    (folder / name).unlink(missing_ok=True)
    os.mkfifo(folder / name)
    with pytest.raises(DataError, match=f"{name}: cannot read the bag: it is a pipe"):
        open_bag(folder, GIVEN)


@pytest.mark.parametrize("compression", ["LZ4", "BZ2"])
def test_a_chunk_that_unpacks_to_more_than_memory_should_hold(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compression: str
) -> None:
    """A compressed chunk of ROS 1 above the limit raises an error; one below it is read."""
    path = bags.write_ros1(tmp_path / "a.bag", np.zeros_like(DEPTH), compression=compression)
    assert len(list(open_bag(path, GIVEN))) == 2
    monkeypatch.setattr(ros_limits, "MAX_CHUNK_BYTES", 5000)
    with pytest.raises(DataError, match=r"a\.bag: .*unpacks to more than 5000 bytes"):
        open_bag(path, GIVEN)


@pytest.mark.parametrize("mode", ["STORAGE", "MESSAGE"])
def test_the_same_of_ros_2(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mode: str) -> None:
    """The limit also holds for chunks of an .mcap file and for messages compressed one by one."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    writer = Writer(tmp_path / "ros2", version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
    messages = bags.Messages(False)
    bags.write(writer, messages, bags.driver(messages, np.zeros_like(DEPTH)))
    assert len(list(open_bag(tmp_path / "ros2", GIVEN))) == 2
    monkeypatch.setattr(ros_limits, "MAX_CHUNK_BYTES", 5000)
    with pytest.raises(DataError, match="unpacks to more than 5000 bytes"):
        open_bag(tmp_path / "ros2", GIVEN)


WRITERS: dict[str, Callable[..., Path]] = {
    "a.bag": bags.write_ros1,
    "sqlite": bags.write_ros2,
    "mcap": functools.partial(bags.write_ros2, storage="MCAP"),
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_message_that_is_larger_than_any_image(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """A message above the limit raises an error, in a database before it is read."""
    path = WRITERS[name](tmp_path / name, DEPTH)
    monkeypatch.setattr(ros_limits, "MAX_MESSAGE_BYTES", 6400)  # a message has 2 * 48 * 64 bytes and its header
    assert len(list(open_bag(path, GIVEN))) == 2
    monkeypatch.setattr(ros_limits, "MAX_MESSAGE_BYTES", 6000)
    with pytest.raises(DataError, match=rf"{name}.*: a message of (61\d\d bytes; expected at most|more than) 6000"):
        open_bag(path, GIVEN)


@pytest.mark.parametrize("name", ["a.bag", "mcap"])
def test_a_chunk_that_is_too_large_to_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """A chunk above the limit raises an error, even if it is not compressed."""
    path = WRITERS[name](tmp_path / name, DEPTH)
    monkeypatch.setattr(ros_limits, "MAX_CHUNK_BYTES", 6000)
    with pytest.raises(DataError, match=rf"{name}.*: a part of the bag has \d+ bytes; expected at most 6000$"):
        open_bag(path, GIVEN)
