"""A track while it is made: a page for the browser, JSON lines over WebSocket, and datagrams."""
