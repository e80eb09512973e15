"""Articulated bodies such as hands: augmentation, forward kinematics, physical limits."""
