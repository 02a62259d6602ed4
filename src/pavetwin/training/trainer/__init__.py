"""The network, its losses and its training, in PyTorch (`pip install pavetwin[train]`).

This package needs torch, torchvision, NumPy and Pillow only, so that it runs on a machine that has no more than those:
`python -m pavetwin.training.trainer`.
"""
