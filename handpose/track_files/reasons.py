"""The beginnings of the reasons why a hand is missing from a frame, for trackers and for synthetic truth."""

LEFT = "left the image"
HIDDEN = "hidden"
PARTLY = "partly in sight"  # in synthetic recordings: such frames are not scored
