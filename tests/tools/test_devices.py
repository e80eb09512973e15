"""tools/devices: each file has a class with the members of a device; its SDK, and a camera, are not there."""

from __future__ import annotations

import importlib
import sys
from unittest.mock import MagicMock

import pytest

from netlib.files.paths import ROOT

SDKS = ("pyorbbecsdk", "depthai", "rclpy", "sensor_msgs", "sensor_msgs.msg")
NAMES = [path.stem for path in (ROOT / "tools" / "devices").glob("[a-z]*.py")]


@pytest.mark.parametrize("name", NAMES)
def test_a_device_can_be_read_and_closed(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for sdk in SDKS:
        monkeypatch.setitem(sys.modules, sdk, MagicMock())
    module = importlib.import_module(f"tools.devices.{name}")
    monkeypatch.delitem(sys.modules, module.__name__)
    (device,) = [kind for kind in vars(module).values() if getattr(kind, "__module__", "") == module.__name__]
    assert callable(device.read) and callable(device.close)
