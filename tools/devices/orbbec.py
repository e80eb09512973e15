"""A Femto, Gemini or Astra of Orbbec: pip install pyorbbecsdk2 (written for 2.1.2)."""

from __future__ import annotations

import numpy as np
from pyorbbecsdk import Config, OBSensorType, Pipeline

from handpose import Camera, CameraInfo, DeviceFrame, Lens

WAIT_MS = 1000


class Orbbec:
    """The depth stream in its default mode."""

    def __init__(self) -> None:
        self._pipeline = Pipeline()
        config = Config()
        profiles = self._pipeline.get_stream_profile_list(OBSensorType.DEPTH_SENSOR)
        profile = profiles.get_default_video_stream_profile()
        config.enable_stream(profile)
        self._pipeline.start(config)
        k, d = profile.get_intrinsic(), profile.get_distortion()
        camera = Camera("orbbec", k.fx, k.fy, k.cx, k.cy, k.width, k.height)
        # with k4, k5, k6 for the model BROWN_CONRADY_K6
        lens = Lens((d.k1, d.k2, d.p1, d.p2, d.k3))
        self.name = "orbbec"
        # unit: a frame's get_depth_scale()
        self.info = CameraInfo(camera, lens, unit_mm=1.0, rate=profile.get_fps())

    def read(self) -> DeviceFrame | None:
        """The next frame; None if none comes."""
        frames = self._pipeline.wait_for_frames(WAIT_MS)
        frame = frames and frames.get_depth_frame()
        if not frame:
            return None
        values = np.frombuffer(frame.get_data(), np.uint16).reshape(
            frame.get_height(), frame.get_width()
        )
        return DeviceFrame(frame.get_timestamp_us() / 1e6, values, frame.get_index())

    def close(self) -> None:
        """Stop the stream."""
        self._pipeline.stop()
