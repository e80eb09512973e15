"""Layers for articulated bodies such as hands: augmentation, forward kinematics,
physical limits.
"""
