"""Detector training: labelled datasets, the network and its trainer, evaluation and reports."""
