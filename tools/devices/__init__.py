"""Depth cameras as devices for handpose.open_device, to copy: one file per SDK.

None was tested with a physical camera.

with open_device(Orbbec()) as recording: ...        docs/camera.md has the rest
"""
