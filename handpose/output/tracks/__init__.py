"""Files of tracks: JSON, JSON lines, CSV and BVH."""
