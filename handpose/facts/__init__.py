"""Facts about data sets and cameras: numbers and names. Imports NumPy alone."""
