"""The joints and angles of a hand as other systems define them: MediaPipe, OpenXR, MANO, NYU's evaluation, anatomy."""
