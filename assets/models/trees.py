"""Broad-leaved street trees: a trunk with boughs, and a crown of leaves, as two meshes that the scene scales apart.

A crown has two levels, as crowns do seen from the air: lobes on the boughs, and on each lobe clumps of twigs, sunlit
domes with dark gaps between them and a ragged outline. A lobe has dark foliage inside that closes it to the eye. A twig
is a card, two triangles kinked along it, and its leaves are cut out of that by a sheet that all crowns share
(`pavetwin.scene.foliage`); its normals are those of its clump's dome, so that a clump is lit as one body. The tint of a
card is its place in the light (Beer's law through the lobes), its tree's, lobe's and clump's green and its own; leaves
are far too many and too thin for occlusion by rays.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from assets.models.common import Floats, Ints, Model, Part, model
from assets.models.rings import rings_along, skin, unit
from pavetwin.scene.foliage import SPRAY

GOLDEN: Final = np.pi * (3.0 - np.sqrt(5.0))
UP: Final = np.array([0.0, 0.0, 1.0])
FLAT: Final = np.array([1.0, 1.0, 0.82])
"""Lobes and clumps are a little flatter than balls."""
LEAF: Final = (0.195, 0.240, 0.092)
"""Reflectance of a leaf in full light, before the tints and the sheet of leaves darken it: broad leaves send back 10 to
15 % of green light and about half of that in red (Jacquemoud and Baret 1990, PROSPECT)."""

INSIDE: Final = 9
"""Cards of dark foliage in a lobe."""


@dataclass(frozen=True, slots=True)
class Form:
    """One form of tree, in metres. `bulge` is the height of the widest place as a share of the crown's."""

    name: str
    crown_radius_m: float
    height_m: float
    clear_m: float
    trunk_radius_m: float
    bulge: float
    lobes: int
    clump_m: float
    """Between one clump of leaves and the next."""
    twigs: int
    twig_m: float
    hue: float
    """Towards yellow above nought, towards blue-green below."""
    seed: int


FORMS: Final[tuple[Form, ...]] = (
    Form("tree_round", 3.0, 8.5, 2.6, 0.17, 0.46, 24, 0.50, 1500, 0.62, 0.05, 1),
    Form("tree_oval", 2.2, 10.5, 2.8, 0.15, 0.40, 26, 0.44, 1500, 0.55, -0.25, 2),
    Form("tree_spreading", 3.9, 8.5, 2.8, 0.22, 0.40, 28, 0.54, 1700, 0.68, 0.25, 3),
    Form("tree_young", 1.2, 5.0, 2.1, 0.06, 0.42, 11, 0.26, 760, 0.44, 0.35, 4),
)


def _profile(form: Form, share: Floats) -> Floats:
    """Radius of the crown's body at a share of its height, as a share of its greatest: an egg standing on its side."""
    above = np.clip((share - form.bulge) / (1.0 - form.bulge), 0.0, 1.0)
    below = np.clip((form.bulge - share) / form.bulge, 0.0, 1.0)
    return np.asarray(np.sqrt(np.clip(1.0 - above**2.0, 0.0, 1.0)) * (1.0 - below**2.2) ** 0.6)


def _lobes(form: Form, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Middles (n, 3) and radii (n,) of a crown's lobes: even over its surface and jostled, a few inside."""
    i = np.arange(form.lobes)
    share = 0.10 + 0.86 * ((i + 0.5) / form.lobes) ** 0.85
    angle = i * GOLDEN + rng.uniform(-0.35, 0.35, form.lobes)
    radii = form.crown_radius_m * rng.uniform(0.23, 0.40, form.lobes) * (36 / form.lobes) ** 0.3
    crown = form.height_m - form.clear_m
    reach = _profile(form, share) * form.crown_radius_m * rng.uniform(0.90, 1.08, form.lobes) - radii
    z = form.clear_m + share * crown - 0.6 * radii * (share > 0.75)
    out = np.maximum(reach, 0.0)
    return np.column_stack([out * np.cos(angle), out * np.sin(angle), z]), radii


def _apart(points: Floats, middles: Floats, radii: Floats, own: Ints) -> Floats:
    """Distance (n,) of points from the nearest lobe but their own, in that lobe's radii."""
    apart = np.linalg.norm((points[:, None] - middles) / FLAT, axis=2) / radii
    apart[np.arange(len(points)), own] = 9.0
    return np.asarray(apart.min(axis=1))


def _clumps(form: Form, middles: Floats, radii: Floats, rng: np.random.Generator) -> tuple[Floats, Floats, Ints]:
    """Middles and outward directions (n, 3 each) of the clumps, and the lobe of each (n,): on lobes, not in others."""
    count = 2500
    lobe = rng.choice(len(radii), count, p=radii**2 / np.sum(radii**2))
    out = unit(rng.standard_normal((count, 3)) + (0.0, 0.0, 0.15))
    points = middles[lobe] + out * (radii[lobe] * rng.uniform(0.70, 0.90, count))[:, None] * FLAT
    free = np.flatnonzero((_apart(points, middles, radii, lobe) > 0.70) & (points[:, 2] > form.clear_m + 0.1))
    kept: list[int] = []
    for candidate in free:  # clumps keep their distance, as twigs do
        if all(np.linalg.norm(points[candidate] - points[k]) > form.clump_m for k in kept):
            kept.append(int(candidate))
    return points[kept], out[kept], lobe[kept]


def _light(form: Form, points: Floats, middles: Floats, radii: Floats) -> Floats:
    """How much of the sky points see, in [0, 1]: less below and between lobes, Beer's law along seven directions."""
    slopes = np.radians([90.0, 55.0, 55.0, 55.0, 20.0, 20.0, 20.0])
    turns = np.array([0.0, 0.0, 2.1, 4.2, 1.0, 3.1, 5.2])
    weights = np.array([1.0, 0.8, 0.8, 0.8, 0.35, 0.35, 0.35])
    seen = np.zeros(len(points))
    for slope, turn, weight in zip(slopes, turns, weights, strict=True):
        ray = np.array([np.cos(slope) * np.cos(turn), np.cos(slope) * np.sin(turn), np.sin(slope)])
        to = middles - points[:, None]
        along = to @ ray
        off = np.sqrt(np.maximum(np.sum(to**2, axis=2) - along**2, 0.0))
        half = np.sqrt(np.maximum(radii**2 - off**2, 0.0))
        path = np.maximum(along + half, 0.0) - np.maximum(along - half, 0.0)
        seen += weight * np.exp(-1.5 * path.sum(axis=1) / form.crown_radius_m * 1.6)
    return np.asarray(seen / weights.sum())


def _crown(form: Form, rng: np.random.Generator) -> list[Part]:
    middles, radii = _lobes(form, rng)
    hue = form.hue + rng.normal(0.0, 0.20, form.lobes)
    twigs = _twigs(form, middles, radii, hue, rng)
    inside = _inside(form, middles, radii, hue, rng)
    low, high = twigs.vertices[:, 2].min(), twigs.vertices[:, 2].max()
    wide = form.crown_radius_m / np.quantile(np.linalg.norm(twigs.vertices[:, :2], axis=1), 0.995)
    for part in (twigs, inside):
        part.vertices[:, :2] *= wide
        part.vertices[:, 2] = np.interp(part.vertices[:, 2], [low, high], [form.clear_m, form.height_m])
    return [twigs, inside]


def _twigs(form: Form, middles: Floats, radii: Floats, hue: Floats, rng: np.random.Generator) -> Part:
    """The cards with the leaves that are seen: out of the clumps, their blades towards the light."""
    clumps, outwards, lobes = _clumps(form, middles, radii, rng)
    size = 0.78 * form.clump_m * rng.uniform(0.75, 1.25, len(clumps))
    # More of them where the light is: there they are seen, from above most of all.
    share = size**2 * (0.35 + 1.3 * _light(form, clumps, middles, radii))
    of = np.sort(rng.choice(len(clumps), form.twigs, p=share / share.sum()))
    count = len(of)
    along = unit(rng.standard_normal((count, 3)) + 1.2 * outwards[of] + 0.10 * UP)
    root = clumps[of] + size[of][:, None] * (0.35 * rng.standard_normal((count, 3)) - 0.35 * outwards[of])
    face = 0.9 * UP + 0.6 * outwards[of] + 0.6 * rng.standard_normal((count, 3))
    length = form.twig_m * rng.uniform(0.75, 1.25, count)
    corners = _cards(root, along, face, length)
    dome = unit(corners - (clumps[of] - 0.6 * size[of][:, None] * outwards[of])[:, None])
    lobe_out = unit(clumps[of] - middles[lobes[of]])
    normals = unit(dome + (0.5 * lobe_out + 0.55 * unit(face) + 0.2 * UP)[:, None])
    light = _light(form, corners.reshape(-1, 3), middles, radii).reshape(count, 4)
    # Within a clump the tips are open, and what lies deep or below is not.
    open_ = np.array([0.55, 0.85, 0.85, 1.0]) * np.clip(0.88 + 0.2 * along[:, 2:], 0.65, 1.0)
    green = _green(hue[lobes[of]] + rng.normal(0.0, 0.15, len(clumps))[of] + rng.normal(0.0, 0.18, count))
    value = (0.28 + 0.72 * light**0.7) * open_ * np.clip(rng.normal(0.92, 0.13, count), 0.6, 1.15)[:, None]
    return _leaf_part(corners, normals, green[:, None] * value[..., None], rng.integers(0, SPRAY, count), rng)


def _inside(form: Form, middles: Floats, radii: Floats, hue: Floats, rng: np.random.Generator) -> Part:
    """The dark foliage inside the lobes that closes them to the eye: sprays of leaves, every way round."""
    lobe = np.repeat(np.arange(form.lobes), INSIDE)
    count = len(lobe)
    away = 0.35 * unit(rng.standard_normal((count, 3))) * rng.random((count, 1)) ** 0.4
    length = 1.25 * radii[lobe]
    along = unit(rng.standard_normal((count, 3)))
    root = middles[lobe] + away * radii[lobe][:, None] * FLAT - 0.5 * along * length[:, None]
    corners = _cards(root, along, rng.standard_normal((count, 3)) + 0.4 * UP, length)
    corners[..., 2] = np.maximum(corners[..., 2], form.clear_m + 0.05)
    normals = unit(corners - middles[lobe][:, None] + 0.3 * UP)
    light = 0.18 + 0.45 * _light(form, corners.reshape(-1, 3), middles, radii).reshape(count, 4)
    value = light * rng.uniform(0.6, 1.2, (count, 1))
    return _leaf_part(corners, normals, _green(hue[lobe])[:, None] * value[..., None], np.full(count, SPRAY), rng)


def _cards(root: Floats, along: Floats, face: Floats, length: Floats) -> Floats:
    """Corners (n, 4, 3) of cards: root, left, right and tip, kinked along the twig so that its sides hang.

    Args:
        root: (n, 3) where the twigs come from.
        along: (n, 3) unit, where they go.
        face: (n, 3) where their blades look, more or less.
        length: (n,) of the twigs, the diagonals of their cards.
    """
    across = unit(np.cross(face, along))
    up = np.cross(along, across)
    way = np.stack([0 * along, 0.5 * along + 0.5 * across, 0.5 * along - 0.5 * across, along], axis=1)
    hang = np.array([0.0, 0.14, 0.14, 0.06])[:, None] * up[:, None]
    return np.asarray(root[:, None] + length[:, None, None] * (way - hang))


def _leaf_part(corners: Floats, normals: Floats, tint: Floats, cell: Ints, rng: np.random.Generator) -> Part:
    """Cards (n, 4, 3) with the twig of a cell (n,) of the sheet on each, half of them mirrored."""
    count = len(corners)
    square = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]])
    mirrored = rng.random(count) < 0.5
    uv = np.where(mirrored[:, None, None], square[:, ::-1], square) + np.column_stack([cell % 2, cell // 2])[:, None]
    triangles = (4 * np.arange(count)[:, None, None] + np.array([[0, 2, 3], [0, 3, 1]])).reshape(-1, 3)
    tint = np.clip(tint, 0.0, 1.0).reshape(-1, 3)
    return Part("leaf", corners.reshape(-1, 3), triangles, normals.reshape(-1, 3), tint, 0.5 * uv.reshape(-1, 2))


def _green(hue: Floats) -> Floats:
    """Tints (n, 3) about the material's green, from bluish to yellowish."""
    return np.asarray(np.clip(np.stack([0.76 + 0.24 * hue, 0.88 + 0.06 * hue, 0.80 - 0.28 * hue], axis=1), 0.0, 1.0))


def _trunk(form: Form, rng: np.random.Generator) -> list[Part]:
    """A trunk flared at its foot, and boughs up into the crown."""
    crown = form.height_m - form.clear_m
    top = form.clear_m + 0.62 * crown
    at = np.array([0.0, 0.02, 0.06, 0.15, 0.35, 0.6, 0.8, 1.0])
    thick = form.trunk_radius_m * np.array([1.55, 1.25, 1.08, 1.0, 0.88, 0.62, 0.42, 0.15])
    bend = form.trunk_radius_m * 0.6 * np.cumsum(rng.standard_normal((len(at), 2)), axis=0) * at[:, None]
    bend[:2] = 0.0
    path = np.column_stack([bend, at * top])
    parts = [
        skin("bark", rings_along(path, np.column_stack([thick, thick]), np.array([1.0, 0.0, 0.0]), 9), start=False)
    ]
    for i in range(9):
        start = 0.86 * form.clear_m + 0.45 * crown * (i / 9)
        root = np.array([np.interp(start, path[:, 2], path[:, 0]), np.interp(start, path[:, 2], path[:, 1]), start])
        angle = i * GOLDEN + rng.uniform(-0.3, 0.3)
        reach = form.crown_radius_m * rng.uniform(0.5, 0.78) * (1.0 - 0.3 * i / 9)
        rise = 0.40 * crown * rng.uniform(0.6, 1.1)
        t = np.array([0.0, 0.25, 0.55, 1.0])[:, None]
        heading = np.array([np.cos(angle), np.sin(angle), 0.0])
        bough = root + heading * reach * t + UP * rise * t**0.8
        width = np.interp(start, path[:, 2], thick) * np.array([0.62, 0.45, 0.30, 0.08])
        parts.append(skin("bark", rings_along(bough, np.column_stack([width, width]), UP, 5), start=False))
    return parts


def tree_model(form: Form) -> Model:
    """The tree as its two nodes."""
    rng = np.random.default_rng(form.seed)
    trunk, crown = Model("trunk", _trunk(form, rng)), Model("crown", _crown(form, rng), reach_m=0.0)
    extras: dict[str, float | str] = {
        "crown_radius_m": form.crown_radius_m,
        "height_m": form.height_m,
        "clear_height_m": form.clear_m,
        "trunk_radius_m": form.trunk_radius_m,
    }
    return Model(form.name, nodes=[trunk, crown], extras=extras, colours={"leaf": LEAF})


def _register(form: Form) -> None:
    @model(form.name)
    def make() -> Model:
        return tree_model(form)


for _form in FORMS:
    _register(_form)
