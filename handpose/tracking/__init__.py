"""Hands followed through a depth recording: where each is, which hand it is, how large, and when it is lost."""
