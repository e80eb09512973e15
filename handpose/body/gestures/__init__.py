"""Gestures that hands show: open, fist, point, pinch, thumb up, two, three, four."""
