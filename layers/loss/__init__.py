"""Loss layers, and layers that measure accuracy."""
