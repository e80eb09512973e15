"""Live output of a track: a browser page, JSON lines over WebSocket, and datagrams."""
