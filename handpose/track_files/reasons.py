"""Why a hand is not told of in a frame: the words with which a reason begins, the same for trackers and for truth."""

LEFT = "left the image"
HIDDEN = "hidden"
PARTLY = "partly in sight"  # of synthetic recordings: neither seen nor lost, so that nobody is blamed
