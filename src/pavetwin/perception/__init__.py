"""The detector: its classes and labelled examples here, its network and training in `pavetwin.training.trainer`.

Nothing here but `training` needs PyTorch, and only that package imports it.
"""
