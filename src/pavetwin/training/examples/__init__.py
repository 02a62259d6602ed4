"""Labelled images to learn from and to measure with: read from COCO files or from one packed file.

NumPy and Pillow are all that is needed here.
"""
