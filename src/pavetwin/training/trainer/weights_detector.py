"""A detector in PyTorch: evaluates weights without an export, and classifies given regions, which the exported graph
cannot."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from pavetwin.arrays import UInt8Array
from pavetwin.labels.boxes import FloatBox, share_within
from pavetwin.perception.detector import Detector
from pavetwin.perception.images import ImageLike, pixels_of
from pavetwin.perception.model_file import ModelFacts
from pavetwin.perception.tiles import tile_windows
from pavetwin.training.network.network import DetectLimits, detect
from pavetwin.training.trainer.export import facts_of
from pavetwin.training.trainer.exported import exported_model, is_exported
from pavetwin.training.trainer.run_folder import load_network


class WeightsDetector(Detector):
    """Detector from a file of weights (`best.pt`) or an exported model, run by PyTorch."""

    def _open(self, path: Path, threads: int) -> ModelFacts:
        if threads:
            torch.set_num_threads(threads)
        if is_exported(path):
            self._network, facts = exported_model(path)
            return facts
        self._network, content = load_network(path)
        return facts_of(self._network, content)

    def _told(self, canvas: UInt8Array) -> dict[str, Any]:
        limits = DetectLimits(confidence=self._confidence, overlap=self._overlap)
        found = detect(self._network, _images(canvas), limits)
        parts: dict[str, list[Any]] = {
            "image": [torch.full((len(each.boxes),), at) for at, each in enumerate(found)],
            "boxes": [each.boxes for each in found],
            "classes": [each.classes for each in found],
            "detection": [each.detection for each in found],
            "subtype": [each.confidence / each.detection for each in found],
        }
        if all(each.masks is not None for each in found):
            parts["masks"] = [each.masks for each in found]
        return {name: torch.cat(values).numpy() for name, values in parts.items()}

    @torch.no_grad()
    def subtypes_at(self, image: ImageLike, boxes: Sequence[FloatBox]) -> list[int]:
        """Most probable index into `SUBTYPES` of each region.

        Args:
            boxes: regions in pixels of the image. With tiles, each is classified in the tile that shows most of it.

        Raises:
            PaveTwinError: the file is not a readable image.
        """
        pixels = pixels_of(image)
        size = (pixels.shape[1], pixels.shape[0])
        is_cut = self.in_tiles(size)
        windows = tile_windows(size, self.image_px) if is_cut else [(0, 0, *size)]
        shares = np.array([[share_within(box, window) for window in windows] for box in boxes])
        subtypes = [0] * len(boxes)
        for at in sorted(set(shares.argmax(axis=1).tolist())) if len(boxes) else ():
            left, top, right, bottom = windows[at]
            part = pixels[top:bottom, left:right]
            shown = part if is_cut else self._fitted(part)
            step = np.array([shown.shape[1] / part.shape[1], shown.shape[0] / part.shape[0]] * 2)
            rows = np.flatnonzero(shares.argmax(axis=1) == at).tolist()
            regions = (np.array([boxes[row] for row in rows]) - [left, top, left, top]) * step
            encoded = self._network(_images(self._canvas([shown])))
            given = torch.tensor(np.hstack([np.zeros((len(rows), 1)), regions]), dtype=torch.float32)
            logits, _ = self._network.regions(encoded.maps, given)
            for row, subtype in zip(rows, logits.argmax(dim=1).tolist(), strict=True):
                subtypes[row] = subtype
        return subtypes


def _images(canvas: UInt8Array) -> torch.Tensor:
    """(batch, 3, rows, columns) in 0 … 1."""
    return torch.from_numpy(canvas).permute(0, 3, 1, 2).float() / 255
