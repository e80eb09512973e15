"""Synthetic hands: poses, flesh, depth images of it, and what a depth sensor makes of them."""
