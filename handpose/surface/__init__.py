"""The surface of a body: capsules about its bones, posed and rendered."""
