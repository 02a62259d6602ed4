"""Frames of a scene."""
