"""Datasets of labelled images of a world, taken from the air or from a car. Import its modules directly."""
