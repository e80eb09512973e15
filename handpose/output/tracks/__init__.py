"""Files of tracks: JSON, JSON lines and CSV."""
