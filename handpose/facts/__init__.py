"""Facts about data sets and cameras: numbers and names. Imports NumPy alone, so anyone may ask for one."""
