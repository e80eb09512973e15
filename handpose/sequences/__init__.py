"""Movements of hands and what a depth camera records of them, for tests and measurements of the tracker."""
