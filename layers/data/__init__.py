"""Where a net's numbers come from."""
