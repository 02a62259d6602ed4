"""Ground and patches baked into textures: base colour and normals from the ground formula.

Images have their upper edge in the north (of a patch: at its largest y), as glTF counts rows.
"""

from dataclasses import dataclass
from io import BytesIO

import numpy as np
from PIL import Image, ImageDraw

from pavetwin.arrays import Float32Array, Float64Array, Int32Array, Int64Array, UInt8Array
from pavetwin.scene.ground.materials.compose import MapPyramids, surface
from pavetwin.scene.ground.materials.sampling import srgb_of_linear
from pavetwin.scene.patches import averaged
from pavetwin.scene.values import PLAIN_FINISH, TILE_M, DefectPatch, GroundKind, GroundPiece, Tile

MOST_POINTS = 1 << 19  # Texels baked at once: some 200 MB


@dataclass(frozen=True)
class BakedTexture:
    """Colour and normals of a surface seen from above; both (rows, cols, 3) uint8."""

    colour: UInt8Array
    """sRGB"""
    normal: UInt8Array
    """Tangent space: 128 for 0 and 255 for 1; red to the right, green up the image."""


def jpeg(pixels: UInt8Array, quality: int, subsampling: str = "4:4:4") -> bytes:
    """The bytes of a JPEG file of (rows, cols, 3)."""
    stream = BytesIO()
    Image.fromarray(pixels).save(stream, "JPEG", quality=quality, subsampling=subsampling, optimize=True)
    return stream.getvalue()


def png(image: Image.Image) -> bytes:
    """The bytes of a PNG file."""
    stream = BytesIO()
    image.save(stream, "PNG", optimize=True)
    return stream.getvalue()


def bake_tile(tile: Tile, maps: MapPyramids, texel_m: float) -> BakedTexture:
    """The ground of a tile from above, `texel_m` metres a texel."""
    side = max(4, round(TILE_M / texel_m))
    which = _triangle_seen(tile.ground, side)
    colour, normal = np.zeros((side, side, 3), dtype=np.uint8), np.zeros((side, side, 3), dtype=np.uint8)
    rows = max(1, MOST_POINTS // side)
    for first in range(0, side, rows):
        strip = slice(first, min(first + rows, side))
        colour[strip], normal[strip] = _strip(tile, maps, which[strip], first)
    return BakedTexture(np.ascontiguousarray(colour[::-1]), np.ascontiguousarray(normal[::-1]))


def _strip(tile: Tile, maps: MapPyramids, which: Int32Array, first: int) -> tuple[UInt8Array, UInt8Array]:
    """Some rows of a tile, from the row `first` on: colour and normals, each (rows, side, 3), row 0 south."""
    rows, side = which.shape
    texel_m = TILE_M / side
    x, y = (np.arange(side) + 0.5) * texel_m, (first + np.arange(rows) + 0.5) * texel_m
    local = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    material, uv, ways = _materials_and_uv(tile, local, which.reshape(-1))
    materials = [*((piece.kind, piece.finish) for piece in tile.ground), (GroundKind.ASPHALT, PLAIN_FINISH)]
    colour = np.zeros((len(local), 3), dtype=np.float32)
    normal = np.zeros((len(local), 3), dtype=np.float32)
    for each in np.unique(material):
        mine = material == each
        kind, finish = materials[each]
        seen = surface(kind, uv[mine], local[mine], tile.origin, maps, texel_m, finish)
        colour[mine], normal[mine] = seen.albedo, seen.normal
    normal[:, :2] = np.einsum("nc,nkc->nk", normal[:, :2], ways)  # from along the grain to the image's axes
    return _coded(colour.reshape(rows, side, 3), normal.reshape(rows, side, 3))


def bake_patch(patch: DefectPatch, origin: tuple[float, float], maps: MapPyramids, texel_m: float) -> BakedTexture:
    """The pavement over a patch's maps, with the defect's reflectance and normals.

    Args:
        origin: of the tile that `maps` belongs to.
        maps: the tile's weathering and markings.
        texel_m: of the image; finer maps are averaged down to about that.
    """
    low, high = _extent(patch)
    cell_m = float(high[0] - low[0]) / patch.relief.shape[1]
    layers = np.concatenate([patch.relief, patch.lost[..., None]], axis=-1).astype(np.float32)
    relief = averaged(layers, max(1, round(texel_m / cell_m)))
    rows, cols = relief.shape[:2]
    x = low[0] + (np.arange(cols) + 0.5) * (high[0] - low[0]) / cols
    y = low[1] + (np.arange(rows) + 0.5) * (high[1] - low[1]) / rows
    own = np.stack(np.meshgrid(x, y), axis=-1)
    turn = patch.transform[:2, :2]
    world = own @ turn.T + patch.transform[:2, 3]
    footprint_m, lost = float((high[0] - low[0]) / cols), relief[..., 4] / 255
    seen = surface(patch.kind, world, world - origin, origin, maps, footprint_m, patch.finish, lost)
    bent = (relief[..., :2] - 128) / 127
    slope = bent / np.sqrt(np.maximum(1e-3, 1 - (bent**2).sum(axis=-1, keepdims=True)))
    grain = (seen.normal[..., :2] / seen.normal[..., 2:]) @ turn.astype(np.float32)
    total = np.concatenate([slope + grain, np.ones((rows, cols, 1), dtype=np.float32)], axis=-1)
    normal = total / np.linalg.norm(total, axis=-1, keepdims=True)
    albedo = np.clip(seen.albedo * (relief[..., 2:3] / 128) * (relief[..., 3:4] / 255), 0, 1).astype(np.float32)
    colour, bent_normal = _coded(albedo, normal.astype(np.float32))
    return BakedTexture(np.ascontiguousarray(colour[::-1]), np.ascontiguousarray(bent_normal[::-1]))


def _extent(patch: DefectPatch) -> tuple[Float64Array, Float64Array]:
    """Corners of the maps in the defect's frame: uv grows in a straight line with the position, in every part alike."""
    if patch.mesh.uv is None:
        raise ValueError(f"the patch of defect {patch.label} has no uv")
    corners = []
    for axis in (0, 1):
        slope, offset = np.polyfit(patch.mesh.uv[:, axis].astype(float), patch.mesh.positions[:, axis].astype(float), 1)
        corners.append((offset, offset + slope))
    (x0, x1), (y0, y1) = corners
    return np.array([x0, y0]), np.array([x1, y1])


def _triangle_seen(ground: tuple[GroundPiece, ...], side: int) -> Int32Array:
    """(side, side) which triangle, counted over all pieces, covers a texel; −1 for none. Row 0 is south."""
    image = Image.new("I", (side, side), -1)
    pen = ImageDraw.Draw(image)
    number = 0
    for piece in ground:
        corners = piece.mesh.positions[piece.mesh.indices][..., :2] * (side / TILE_M) - 0.5
        for triangle in corners.reshape(-1, 6).tolist():
            pen.polygon(triangle, fill=number)
            number += 1
    return np.asarray(image, dtype=np.int32)


def _materials_and_uv(
    tile: Tile, local: Float64Array, which: Int32Array
) -> tuple[Int64Array, Float64Array, Float32Array]:
    """The piece (n,) and detail coordinates (n, 2) at points of the tile, and the unit vectors along which those grow,
    the columns of (n, 2, 2). In holes the piece is −1, and grain lies along the world's axes."""
    pieces = [np.full(len(piece.mesh.indices), number) for number, piece in enumerate(tile.ground)]
    piece_of = np.concatenate([*pieces, [-1]])
    maps = [_uv_maps(piece) for piece in tile.ground]
    plain = np.array([[[1.0, 0.0], [0.0, 1.0], list(tile.origin)]])
    every = np.concatenate([*maps, plain])
    affine = every[which]
    uv = local[:, :1] * affine[:, 0] + local[:, 1:] * affine[:, 1] + affine[:, 2]
    ways = every[:, :2] / np.maximum(np.linalg.norm(every[:, :2], axis=1, keepdims=True), 1e-9)
    return piece_of[which], uv, ways.astype(np.float32)[which]


def _uv_maps(piece: GroundPiece) -> Float64Array:
    """(m, 3, 2) of each triangle: how uv grows with x, with y, and uv at the origin."""
    assert piece.mesh.uv is not None
    xy = piece.mesh.positions[piece.mesh.indices][..., :2].astype(np.float64)
    uv = piece.mesh.uv[piece.mesh.indices].astype(np.float64)
    edges, steps = xy[:, 1:] - xy[:, :1], uv[:, 1:] - uv[:, :1]
    flat = np.abs(np.linalg.det(edges)) < 1e-9
    edges[flat], steps[flat] = np.eye(2), 0.0
    slopes = np.linalg.solve(edges, steps)
    offset = uv[:, 0] - np.einsum("nk,nkc->nc", xy[:, 0], slopes)
    return np.concatenate([slopes, offset[:, None]], axis=1)


def _coded(albedo: Float32Array, normal: Float32Array) -> tuple[UInt8Array, UInt8Array]:
    """Linear reflectance and unit normals as a `BakedTexture` holds them."""
    colour = np.round(255 * srgb_of_linear(albedo)).astype(np.uint8)
    return colour, np.round(np.clip(normal, -1, 1) * 127 + 128).astype(np.uint8)
