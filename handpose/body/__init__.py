"""A body: its sides, the data sets' joints, the surface of capsules around its
bones, its gestures.
"""
