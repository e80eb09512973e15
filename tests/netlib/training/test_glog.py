"""netlib/training/report.py: the log; names in messages cannot add lines."""

from __future__ import annotations

import io
import logging
import re
from collections.abc import Iterator
from pathlib import PurePosixPath

import numpy as np
import pytest
from hypothesis import given

from netlib.caffe import _caffe
from netlib.proto import prototxt
from netlib.proto.prototxt import Message, Place
from netlib.training import report
from tests.netlib.test_errors import ANY_TEXT

STAMP = r"I\d{4} \d\d:\d\d:\d\d\.\d{6} \d+ \w+\.py:\d+\] "


@pytest.fixture(scope="module")
def log() -> Iterator[io.StringIO]:
    """The output of the log in glog's format."""
    text = io.StringIO()
    handler = logging.StreamHandler(text)
    handler.setFormatter(report.CaffeFormatter())
    before = report.log.level
    report.log.addHandler(handler)
    report.log.setLevel(logging.INFO)
    yield text
    report.log.removeHandler(handler)
    report.log.setLevel(before)


def written(log: io.StringIO) -> str:
    text = log.getvalue()
    log.seek(0)
    log.truncate()
    return text


@given(ANY_TEXT)
def test_a_name_stays_in_its_line(log: io.StringIO, name: str) -> None:
    for text, *args in (
        ("Creating Layer %s", name),
        ("%s: %r", PurePosixPath(name), name),
        (f"no weights for {name}",),
    ):
        report.log.info(text, *args)
        line = written(log)
        assert re.match(STAMP, line)
        assert line[-1] == "\n"
        assert line[:-1].isprintable()


@given(ANY_TEXT)
def test_a_prototxt_has_its_lines(log: io.StringIO, name: str) -> None:
    """A prototxt is logged on its own lines; a quoted name in it cannot start a new one."""
    here = Place("")
    tree = Message([prototxt.Field("net", prototxt.Scalar("string", name, here), here)] * 2, here)
    report.log.info("Initializing solver from parameters: \n%s", tree)
    first, *others = written(log).split("\n")
    assert re.fullmatch(STAMP + "Initializing solver from parameters: ", first)
    assert others == [*str(tree).split("\n")[:2], ""]
    assert all(map(str.isprintable, others))


def test_numbers_are_formatted_as_in_logging(log: io.StringIO) -> None:
    report.log.info("%d %.6g %.3g %s", 3, np.float32(0.1), np.array(2.0), None)
    assert written(log).endswith("] 3 0.1 2 None\n")


def test_pycaffes_log_takes_lines(log: io.StringIO) -> None:
    _caffe.log("one\ntwo\x1b")
    assert [re.sub(STAMP, "", line) for line in written(log).splitlines()] == ["one", "two\\x1b"]
