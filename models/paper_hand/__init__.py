"""A hand of synthetic frames: the net, its weights, what they are worth."""
