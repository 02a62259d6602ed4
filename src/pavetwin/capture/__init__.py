"""Datasets of labelled images, taken of a world from the air or from a car. Its parts are imported where used."""
