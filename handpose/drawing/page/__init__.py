"""A browser page in one file that shows a body: its sources and their assembly."""
