"""The joints and angles of a hand as other systems define them: MediaPipe, MANO, NYU's
evaluation, anatomy.
"""
