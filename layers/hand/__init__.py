"""Articulated bodies, as the hand: augmentation, forward kinematics, physical limits."""
