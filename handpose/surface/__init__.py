"""The surface of a body: capsules around its bones, posed and rendered."""
