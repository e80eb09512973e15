"""A network that finds hands: the net, its weights, what they are worth."""
