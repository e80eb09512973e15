"""A file per format of recordings: folders, stacks, videos, ROS bags, a live camera."""
