"""The hand: augmentation, forward kinematics, physical limits."""
