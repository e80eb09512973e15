"""Interruptible training: stop requests, rollback of a partial iteration, reserved snapshots."""
