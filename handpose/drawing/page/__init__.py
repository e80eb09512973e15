"""A page for the browser that shows a body, in one file: its sources, and what puts them together."""
