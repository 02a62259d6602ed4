"""Overlapping tiles of large images, and the merging of detections across seams."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np

from pavetwin.arrays import BoolArray, Float64Array, IndexArray
from pavetwin.detections import IS_COVERED, Detections, MaskPart
from pavetwin.labels.boxes import PixelBox
from pavetwin.labels.class_names import CRACKS, coarse_of_classes
from pavetwin.perception.suppression import areas

OVERLAP: Final = 0.2
"""Least overlap of neighbouring tiles, as a share of their side."""

EDGE_PX: Final = 16.0
"""Distance to a seam within which a box may continue behind it: boxes of thin cracks often end before the crack."""

SAME: Final = 0.5
"""IoU from which two tiles' boxes of one coarse class are one object, within the area that both tiles see."""

GOES_ON: Final = 0.3
"""IoU from which two single cracks are one, between the boxes around the cells of their masks, which are coarse: masks
have 28 × 28 cells."""

ABSORBED: Final = 0.7
"""Share of a part within the box of an object from which it adds nothing to it."""

TRUSTED: Final = 0.5
"""Share of the confidence of an object's most confident part from which another part may change its box."""


def tile_windows(size_px: tuple[int, int], side_px: int) -> list[PixelBox]:
    """The smallest number of evenly spaced tiles that cover an image (width, height) and overlap by `OVERLAP`."""

    def starts(length: int) -> list[int]:
        if length <= side_px:
            return [0]
        count = 1 + int(np.ceil((length - side_px) / (side_px * (1 - OVERLAP))))
        return [round((length - side_px) * at / (count - 1)) for at in range(count)]

    width, height = size_px
    tiles = product(starts(height), starts(width))
    return [(x, y, min(x + side_px, width), min(y + side_px, height)) for y, x in tiles]


def merged(found: Sequence[Detections], tiles: Sequence[PixelBox]) -> Detections:
    """Merge the detections of an image's tiles, so that each object appears once.

    Two boxes of one coarse class are one object where their IoU within the area that both tiles see is high. Single
    cracks that end at seams are compared by the boxes around the cells of their masks there: the boxes of a slanting
    crack diverge from the seam, and those of two parallel cracks overlap. As in non-maximum suppression, the most
    confident box comes first and absorbs those that match it. An object that one tile sees whole is kept as it is;
    parts that end at seams are joined, unless they are much less confident, so that a doubtful box never enlarges a
    good one. The class of an object is that of its most confident part, weighted by the part's area.

    Args:
        found: detections of each tile, in pixels of the image.
        tiles: left, top, right, bottom. One may be the whole image.
    """
    pieces = _pieces(found, tiles)
    groups = _groups(pieces, tiles)
    joined = pieces.detections[[_judge(group, pieces) for group in groups]].with_columns(
        box_px=[_box(group, pieces) for group in groups],
        mask=[tuple(part for row in group for part in pieces.detections.mask[row]) for group in groups],
    )
    surest = joined.detection_confidence.astype(np.float64) * joined.subtype_confidence
    return joined[np.argsort(-surest, kind="stable")]


@dataclass(frozen=True, slots=True)
class _Pieces:
    """The detections of all tiles, a row each."""

    detections: Detections
    tile: IndexArray
    is_cut: BoolArray
    """Whether it ends at a seam."""
    cells: tuple[Float64Array | None, ...]
    """(n,) For a single crack that ends at a seam, the edges (cells, 4) of its mask's cells in pixels of the image;
    None for others."""
    coarse: IndexArray
    """Number of the coarse class."""

    @property
    def boxes(self) -> Float64Array:
        """(n, 4) in pixels of the image."""
        return self.detections.box_px

    @property
    def confidence(self) -> Float64Array:
        return self.detections.confidence


def _pieces(found: Sequence[Detections], tiles: Sequence[PixelBox]) -> _Pieces:
    detections = Detections.concatenated(found)
    tile = np.repeat(np.arange(len(tiles)), [len(each) for each in found])
    boxes = detections.box_px
    edges = np.array(tiles, dtype=float)[tile]
    width, height = found[0].size_px or (0, 0)
    seams = edges != [0, 0, width, height]
    is_cut = (seams & (np.abs(boxes - edges) <= EDGE_PX)).any(axis=1)
    is_crack = detections.class_name == CRACKS[0]
    return _Pieces(
        detections=detections,
        tile=tile,
        is_cut=is_cut,
        cells=tuple(
            _cells(mask) if wanted else None for mask, wanted in zip(detections.mask, is_cut & is_crack, strict=True)
        ),
        coarse=coarse_of_classes(detections.class_number),
    )


def _groups(pieces: _Pieces, tiles: Sequence[PixelBox]) -> list[list[int]]:
    """The pieces that make up each object, the most confident objects first."""
    windows = np.array(tiles, dtype=float)
    in_tile = [np.flatnonzero(pieces.tile == at) for at in range(len(tiles))]
    near = [_neighbours(at, windows, in_tile) for at in range(len(tiles))]
    is_left = np.ones(len(pieces.boxes), dtype=bool)
    groups = []
    for first in np.argsort(-pieces.confidence, kind="stable").tolist():
        if not is_left[first]:
            continue
        is_left[first] = False
        group, heads = [first], deque([first])
        while heads:
            head = heads.popleft()
            same = _same(head, near[pieces.tile[head]], pieces, windows, is_left)
            is_left[same] = False
            if not pieces.is_cut[group[0]]:
                continue
            trusted = [at for at in same.tolist() if pieces.confidence[at] >= TRUSTED * pieces.confidence[first]]
            whole = [at for at in trusted if not pieces.is_cut[at] and _covers(at, group, pieces)][:1]
            group = whole or group + trusted
            heads.extend(whole or trusted)
        for at in group:
            others = near[pieces.tile[at]]
            rest = others[is_left[others] & pieces.is_cut[others] & (pieces.coarse[others] == pieces.coarse[first])]
            is_left[rest[_shares(pieces.boxes[rest], pieces.boxes[at]) >= ABSORBED]] = False
        groups.append(group)
    return groups


def _covers(piece: int, group: Sequence[int], pieces: _Pieces) -> bool:
    """Whether a piece covers most of the box around a group."""
    return bool(_shares(_box(group, pieces)[None], pieces.boxes[piece])[0] >= ABSORBED)


def _neighbours(tile: int, windows: Float64Array, in_tile: Sequence[IndexArray]) -> IndexArray:
    """The pieces of all other tiles that overlap a tile."""
    starts, ends = np.maximum(windows[:, :2], windows[tile, :2]), np.minimum(windows[:, 2:], windows[tile, 2:])
    others = np.flatnonzero((starts < ends).all(axis=1)).tolist()
    return np.concatenate([in_tile[at][:0] if at == tile else in_tile[at] for at in others])


def _same(piece: int, others: IndexArray, pieces: _Pieces, windows: Float64Array, is_left: BoolArray) -> IndexArray:
    """The pieces of other tiles that show the same object, the most confident first."""
    others = others[is_left[others] & (pieces.coarse[others] == pieces.coarse[piece])]
    window = windows[pieces.tile[piece]]
    theirs = windows[pieces.tile[others]]
    shared = np.hstack([np.maximum(theirs[:, :2], window[:2]), np.minimum(theirs[:, 2:], window[2:])])
    mine = _within(np.broadcast_to(pieces.boxes[piece], shared.shape), shared)
    seen = _within(pieces.boxes[others], shared)
    both = areas(_within(mine, seen))
    is_same = both > SAME * np.maximum(areas(mine) + areas(seen) - both, 1e-9)
    cells = pieces.cells[piece]
    if cells is not None:
        for at in np.flatnonzero(both > 0):
            theirs_cells = pieces.cells[others[at]]
            if theirs_cells is not None:
                is_same[at] = _is_one_crack(cells, theirs_cells, shared[at])
    same = others[is_same]
    return same[np.argsort(-pieces.confidence[same], kind="stable")]


def _is_one_crack(first: Float64Array, second: Float64Array, shared: Float64Array) -> bool:
    """Whether two parts are one crack: the boxes around their cells agree within the area that both tiles see."""
    seen = [_around(cells, shared) for cells in (first, second)]
    if seen[0] is None or seen[1] is None:
        return False
    mine, theirs = seen[0][None], seen[1][None]
    both = areas(_within(mine, theirs))[0]
    return bool(both > GOES_ON * max(areas(mine)[0] + areas(theirs)[0] - both, 1e-9))


def _around(cells: Float64Array, window: Float64Array) -> Float64Array | None:
    """The box around the cells within a window; None without any."""
    inside = _within(cells, np.broadcast_to(window, cells.shape))
    inside = inside[(inside[:, :2] < inside[:, 2:]).all(axis=1)]
    return np.concatenate([inside[:, :2].min(axis=0), inside[:, 2:].max(axis=0)]) if len(inside) else None


def _cells(parts: Sequence[MaskPart]) -> Float64Array | None:
    """(cells, 4) The cells that a mask covers; None for an empty or missing mask."""
    found = []
    for part in parts:
        rows, columns = np.nonzero(part.grid >= IS_COVERED)
        width, height = part.cell_px
        left, top = part.box[0] + columns * width, part.box[1] + rows * height
        found.append(np.stack([left, top, left + width, top + height], axis=1))
    cells = np.concatenate(found) if found else np.empty((0, 4))
    return cells if len(cells) else None


def _box(group: Sequence[int], pieces: _Pieces) -> Float64Array:
    boxes = pieces.boxes[list(group)]
    return np.concatenate([boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)])


def _within(boxes: Float64Array, windows: Float64Array) -> Float64Array:
    return np.hstack([np.maximum(boxes[:, :2], windows[:, :2]), np.minimum(boxes[:, 2:], windows[:, 2:])])


def _shares(boxes: Float64Array, window: Float64Array) -> Float64Array:
    """(n,) Share of each box within a window."""
    return areas(_within(boxes, np.broadcast_to(window, boxes.shape))) / np.maximum(areas(boxes), 1e-9)


def _judge(group: Sequence[int], pieces: _Pieces) -> int:
    """The piece that gives an object its class and confidence."""
    return max(group, key=lambda at: pieces.confidence[at] * areas(pieces.boxes[[at]])[0])
