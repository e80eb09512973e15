"""Live output of a track: a browser page, and JSON lines over WebSocket."""
