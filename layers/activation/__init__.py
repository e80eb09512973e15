"""Elementwise activation layers."""
