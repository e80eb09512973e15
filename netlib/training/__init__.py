"""Support for the training loop: solver options, log lines, exact resume."""
