"""From a depth image to the joints of a hand: find it, crop it, run a net, move the crop."""
