"""Synthetic recordings of moving hands, for tests and measurements of the tracker."""
