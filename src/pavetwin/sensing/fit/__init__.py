"""Fits the sensor `calibrated`. It is not loaded with the sensors, which need neither SciPy nor Polars."""
