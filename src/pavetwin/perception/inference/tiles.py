"""Large images at their own resolution: in tiles that overlap, and what crosses a seam put together again."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np

from pavetwin.labels.boxes import FloatBox, PixelBox, area, share_within, within
from pavetwin.perception.classes import SUBTYPES
from pavetwin.perception.inference.detections import Detections, MaskPart

OVERLAP: Final = 0.2
"""Of neighbouring tiles, as a share of their side, at least."""

EDGE_PX: Final = 3.0
"""A box that ends this near to a seam may go on behind it."""

SAME: Final = 0.5
"""IoU from which two tiles' boxes of one coarse class are one object, compared in what both tiles see."""

ABSORBED: Final = 0.7
"""Share of a box in another one of the same object, which a tile sees whole, from which it adds nothing to it."""


def tile_windows(size_px: tuple[int, int], side_px: int) -> list[PixelBox]:
    """The fewest tiles that cover an image (width, height) and overlap by `OVERLAP`, evenly spread."""

    def starts(length: int) -> list[int]:
        if length <= side_px:
            return [0]
        count = 1 + int(np.ceil((length - side_px) / (side_px * (1 - OVERLAP))))
        return [round((length - side_px) * at / (count - 1)) for at in range(count)]

    width, height = size_px
    tiles = product(starts(height), starts(width))
    return [(x, y, min(x + side_px, width), min(y + side_px, height)) for y, x in tiles]


@dataclass(frozen=True, slots=True)
class _Piece:
    """What one tile says of an object."""

    tile: int
    row: int
    box: FloatBox
    is_cut: bool
    coarse: int
    """0 for every defect, else the class."""
    confidence: float


def merged(found: Sequence[Detections], tiles: Sequence[PixelBox]) -> Detections:
    """The detections of an image from those of its tiles, an object once.

    Two boxes of one coarse class are one object where they agree (IoU) in what both tiles see. What one tile sees whole
    stays as it is; parts that end at seams are joined. The class of an object is that of its most confident part,
    weighted by the part's area.

    Args:
        found: of each tile, in pixels of the image.
        tiles: left, top, right, bottom.
    """
    size = found[0].size_px
    pieces = [piece for at in range(len(tiles)) for piece in _pieces(at, found[at], tiles[at], size)]
    rows = [_joined(group, found) for group in _groups(pieces, tiles)]
    rows.sort(key=lambda row: -row[2] * row[3])
    boxes = np.array([row[0] for row in rows], dtype=np.float32).reshape(-1, 4)
    return Detections(
        size,
        boxes,
        np.array([row[1] for row in rows], dtype=np.int64),
        np.array([row[2] for row in rows], dtype=np.float32),
        np.array([row[3] for row in rows], dtype=np.float32),
        tuple(row[4] for row in rows),
    )


def _pieces(at: int, found: Detections, tile: PixelBox, size: tuple[int, int]) -> list[_Piece]:
    seams = (tile[0] > 0, tile[1] > 0, tile[2] < size[0], tile[3] < size[1])
    pieces = []
    for row in range(len(found)):
        box = found.box(row)
        ends = (abs(side - edge) <= EDGE_PX for side, edge in zip(box, tile, strict=True))
        is_cut = any(seam and end for seam, end in zip(seams, ends, strict=True))
        coarse = max(0, int(found.classes[row]) - len(SUBTYPES) + 1)
        pieces.append(_Piece(at, row, box, is_cut, coarse, float(found.confidence[row])))
    return pieces


def _groups(pieces: Sequence[_Piece], tiles: Sequence[PixelBox]) -> list[list[_Piece]]:
    """Pieces of one object together: linked directly or through others."""
    group = list(range(len(pieces)))

    def root(at: int) -> int:
        while group[at] != at:
            at = group[at]
        return at

    for at, one in enumerate(pieces):
        for before in range(at):
            if _is_same(pieces[before], one, tiles):
                group[root(at)] = root(before)
    gathered: dict[int, list[_Piece]] = {}
    for at, piece in enumerate(pieces):
        gathered.setdefault(root(at), []).append(piece)
    return list(gathered.values())


def _is_same(one: _Piece, other: _Piece, tiles: Sequence[PixelBox]) -> bool:
    if one.tile == other.tile or one.coarse != other.coarse:
        return False
    shared = within(tiles[one.tile], tiles[other.tile])
    if shared is None:
        return False
    first, second = within(one.box, shared), within(other.box, shared)
    if first is None or second is None or (both := within(first, second)) is None:
        return False
    inner = area(both)
    return inner >= SAME * (area(first) + area(second) - inner)


def _joined(
    group: list[_Piece], found: Sequence[Detections]
) -> tuple[FloatBox, int, float, float, tuple[MaskPart, ...]]:
    """Box, class, both confidences and mask of one object."""
    ordered = sorted(group, key=lambda piece: (piece.is_cut, -piece.confidence))
    kept = [ordered[0]]
    box = ordered[0].box
    for piece in ordered[1:]:
        is_copy = not piece.is_cut and share_within(box, piece.box) >= ABSORBED
        if not kept[0].is_cut and (is_copy or share_within(piece.box, box) >= ABSORBED):
            continue
        box = (*(min(box[at], piece.box[at]) for at in (0, 1)), *(max(box[at], piece.box[at]) for at in (2, 3)))  # type: ignore[assignment]
        kept.append(piece)
    judge = max(kept, key=lambda piece: piece.confidence * area(piece.box))
    of = found[judge.tile]
    masks = tuple(part for piece in kept for part in found[piece.tile].masks[piece.row])
    return box, int(of.classes[judge.row]), float(of.detection[judge.row]), float(of.subtype[judge.row]), masks
