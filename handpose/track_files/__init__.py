"""What is told of hands over time: the data, and the files that others read."""
