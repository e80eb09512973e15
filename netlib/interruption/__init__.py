"""Stop training at any time without loss: requests, undo of a cut iteration, reserved snapshots."""
