"""Track hands through a depth recording: positions, sides and sizes, and when a hand is lost."""
