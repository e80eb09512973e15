"""What is known about hands and depth cameras."""
