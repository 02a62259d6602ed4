"""Training and export of the detector, in PyTorch (`pip install pavetwin[train]`).

Training needs torch, torchvision, NumPy, Pillow and pycocotools only: `python -m pavetwin.training.trainer` runs where
nothing else is installed.
"""
