"""A layer from its text: the class of its type, its options, a user's own Python layers."""
