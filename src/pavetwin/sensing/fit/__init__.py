"""Fitting of the calibrated sensor to looks at defects; apart from the sensors, since it loads polars and SciPy."""
