"""What is minimised, and what is only measured."""
