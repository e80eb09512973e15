"""Fitting a skeleton to joints: the pose of each frame, or the hand of a person."""
