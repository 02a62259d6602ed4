"""Walls with their openings: bays along a wall, storeys up it, a window in each, set back into the wall."""

from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np

from pavetwin.arrays import Float64Array
from pavetwin.scene.buildings.faces import Faces
from pavetwin.scene.buildings.layers import CELL_M, CELLS, FACADE_REPEAT_M, FacadeTexture
from pavetwin.scene.buildings.styles import FacadeStyle, GroundFloor, HouseDetail, Windows

SHORTEST_M = 1.3  # A shorter wall has no openings
MARGIN_M, MARGIN_SHARE = 0.35, 0.12
"""Width of plain wall at a wall's ends; for a short wall this share of it."""

PLINTH_M = 0.45
SILL_M = (0.06, 0.05)
"""Projection of a window sill, and its thickness."""

PROUD_M = 0.03  # How far openings lie before their wall where it has no reveals
BLANK_SHADE = 0.85
"""Factor on a wall that stands for one with openings: a fifth of it is panes, which reflect a quarter as much."""

SHADE_BELOW_EAVES, SHADE_AT_FOOT = 0.86, 0.80
"""Ambient occlusion in corners: factors on the colours there."""

SHADES_IN_REVEAL = np.array([0.75, 0.75, 0.62, 0.95])[:, None]
"""The same of a reveal's left, right, upper and lower side."""

SHOP_M, LOBBY_M = 3.7, 3.5
"""Heights of ground floors that are more than a storey of dwellings."""

SLAB_ENDS = np.array([[0, 1, 1, 0], [0, 1, 1, 0], [0, 1, 1, 0], [0, 0, 0, 0], [1, 1, 1, 1]])
SLAB_HEIGHTS = np.array([[0, 0, 1, 1], [1, 1, 1, 1], [0, 0, 0, 0], [0, 0, 1, 1], [0, 0, 1, 1]])
SLAB_FRONT = np.array([[1, 1, 1, 1], [1, 1, 0, 0], [0, 0, 1, 1], [0, 1, 1, 0], [1, 0, 0, 1]], dtype=bool)
"""The four corners of a slab's front, top, underside and two ends: which end along the wall, bottom or top, and
whether at the front."""

SLAB_SHADES = np.array([1.0, 1.05, 0.6, 0.9, 0.9])[:, None, None]


@dataclass(frozen=True)
class Wall:
    """One side of a building, seen from outside with `start` on the left."""

    start: Float64Array
    """(2,)"""
    end: Float64Array
    """(2,)"""
    top_m: float
    """Height of its top, below the roof."""
    party: bool
    """Against another building: no openings."""
    front: bool
    """Towards the street: doors, shops and gates are here."""
    offset_m: float
    """Way along the building's ring to `start`: where its texture begins."""

    @cached_property
    def length_m(self) -> float:
        return float(np.hypot(*(self.end - self.start)))

    @cached_property
    def along(self) -> Float64Array:
        return np.asarray((self.end - self.start) / self.length_m)

    @cached_property
    def outward(self) -> Float64Array:
        """(2,) the wall's normal."""
        x, y = self.along
        return np.array([y, -x])

    def points(self, u: Float64Array, z: Float64Array, depth: Float64Array | float = 0.0) -> Float64Array:
        """(..., 3) for metres along the wall, up it, and into the building."""
        flat = self.start + u[..., None] * self.along - np.asarray(depth)[..., None] * self.outward
        return np.concatenate([flat, np.broadcast_to(z, u.shape)[..., None]], axis=-1)


@dataclass(frozen=True)
class WallBuilder:
    """Adds one wall with its openings."""

    faces: Faces
    wall: Wall
    style: FacadeStyle
    rng: np.random.Generator
    detail: HouseDetail = HouseDetail.FULL
    _panelled: list[Float64Array] = field(default_factory=list, init=False)
    """Rectangles of wall until they are added, (n, 7) each: left, right, low, high, colour."""

    def build(self) -> None:
        self._build()
        if self._panelled:
            self._rectangles(np.concatenate(self._panelled))

    def _build(self) -> None:
        wall, style = self.wall, self.style
        floors = _floors(style, wall.top_m)
        bays = _bays(style, wall)
        colour = np.array(style.colour)
        whole = np.array([0.0, wall.length_m])
        if self.detail is not HouseDetail.FULL:
            shade = BLANK_SHADE if self.detail is HouseDetail.BLANK and len(bays) and not wall.party else 1.0
            self._panelled.append(np.array([[0.0, wall.length_m, 0.0, wall.top_m, *(colour * shade)]]))
        plinth = 0.0 if style.ground is GroundFloor.SHOP and wall.front else min(PLINTH_M, 0.2 * wall.top_m)
        if plinth and not wall.party:  # a darker band along the foot, two centimetres proud of the wall
            self._slab(whole, np.array([0.0, plinth]), 0.02, np.array(style.plinth), 0.9)
        if wall.party or not len(bays):
            self._plain(0.0, wall.length_m, 0.0, wall.top_m, colour)
            return
        left, right = bays[0, 0], bays[-1, 1]
        self._plain(0.0, left, 0.0, wall.top_m, colour)
        self._plain(right, wall.length_m, 0.0, wall.top_m, colour)
        for number, (low, high) in enumerate(floors):
            if number == 0:
                self._ground_floor(bays, low, high)
            else:
                self._storey(bays, low, high)
        self._plain(left, right, floors[-1][1], wall.top_m, colour * SHADE_BELOW_EAVES)
        if style.cornice:
            z, half = floors[0][1], 0.16 / 2
            self._slab(whole, np.array([z - half, z + half]), 0.10, np.array(style.trim), 0.8)

    def _ground_floor(self, bays: Float64Array, low: float, high: float) -> None:
        """The ground floor: on the front a door, shop windows or gates; windows elsewhere."""
        own = np.zeros(len(bays), dtype=bool)
        height, use, rng = high - low, self.style.ground, self.rng
        if self.wall.front:
            door = int(rng.integers(len(bays)))
            own[door] = True
            at = bays[door : door + 1]
            bay = float(at[0, 1] - at[0, 0])
            if use in (GroundFloor.GARAGE, GroundFloor.HALL):
                garage = use is GroundFloor.GARAGE
                cell = int(rng.integers(8, 12) if garage else rng.integers(12, 16))
                wide, tall = min(bay - 0.3, 3.6) / bay, min(0.88, (2.3 if garage else 3.2) / height)
                self._openings(at, low, high, Windows(FacadeTexture.DOORS, (cell,), wide, tall, 0.0, 0.15, False))
            elif use is GroundFloor.SHOP:
                own[:] = True
                self._shop(bays, low, high, door)
            else:
                cell = int(rng.integers(8))
                wide, tall = min(0.8, (1.1 if use is GroundFloor.HOME else 2.0) / bay), min(0.85, 2.2 / height)
                self._openings(at, low, high, Windows(FacadeTexture.DOORS, (cell,), wide, tall, 0.0, 0.25, False))
        self._storey(bays[~own], low, high)

    def _shop(self, bays: Float64Array, low: float, high: float, door: int) -> None:
        """Large panes between piers, a door among them, a board with the shop's name above."""
        height, rng = high - low, self.rng
        cells = tuple(int(n) for n in rng.integers(8, 16, 4))
        panes = Windows(FacadeTexture.GLAZING, cells, 0.9, 2.75 / height - 0.1, 0.1, 0.12, False)
        self._openings(np.delete(bays, door, axis=0), low, high, panes)
        wide = min(0.7, 1.2 / float(bays[door, 1] - bays[door, 0]))
        windows = Windows(FacadeTexture.DOORS, (1, 3, 5, 7), wide, 2.4 / height, 0.0, 0.3, False)
        self._openings(bays[door : door + 1], low, high, windows)
        hue = rng.uniform(0.02, 0.35, 3) * float(rng.uniform(0.4, 1.0))
        self._slab(np.array([bays[0, 0], bays[-1, 1]]), np.array([low + 2.85, low + 3.4]), 0.09, hue, 0.4)

    def _storey(self, bays: Float64Array, low: float, high: float) -> None:
        if self.style.windows is not None and len(bays):
            self._openings(bays, low, high, self.style.windows)
        else:
            for left, right in bays:
                self._plain(float(left), float(right), low, high, np.array(self.style.colour))

    def _openings(self, bays: Float64Array, low: float, high: float, windows: Windows) -> None:
        """A row of equal openings: the wall around each, its reveal, its filling, its sill."""
        if not len(bays):
            return
        middle, width = bays.mean(axis=1), (bays[:, 1] - bays[:, 0]) * windows.width
        u0, u1 = middle - width / 2, middle + width / 2
        z0 = np.full(len(bays), low + (high - low) * windows.sill)
        z1 = z0 + (high - low) * windows.height
        lows, highs = np.full(len(bays), low), np.full(len(bays), high)
        colour = np.array(self.style.colour)
        self._panels(bays[:, 0], bays[:, 1], lows, z0, colour)
        self._panels(bays[:, 0], bays[:, 1], z1, highs, colour)
        self._panels(bays[:, 0], u0, z0, z1, colour)
        self._panels(u1, bays[:, 1], z0, z1, colour)
        self._reveals(u0, u1, z0, z1, windows.reveal_m)
        cells = self.rng.choice(windows.cells, len(bays))
        u, z = np.stack([u0, u1, u1, u0], axis=1), np.stack([z0, z0, z1, z1], axis=1)
        if self.detail is not HouseDetail.BLANK:
            corners = self.wall.points(u, z, windows.reveal_m if self.detail is HouseDetail.FULL else -PROUD_M)
            self.faces.quads(windows.layer, corners, (1.0, 1.0, 1.0), uv=_cell_uv(cells), roughness=0.2)
        if windows.with_sill:
            out, thick = SILL_M
            ends, bands = np.stack([u0 - 0.05, u1 + 0.05], axis=1), np.stack([z0 - thick, z0], axis=1)
            self._slab(ends, bands, out, np.array(self.style.trim), 0.7)

    def _panels(
        self, left: Float64Array, right: Float64Array, low: Float64Array, high: Float64Array, colour: Float64Array
    ) -> None:
        """Rectangles of wall around openings, where these are set back."""
        if self.detail is HouseDetail.FULL:
            rows = np.empty((len(left), 7))
            for column, values in enumerate((left, right, low, high)):
                rows[:, column] = values
            rows[:, 4:] = colour
            self._panelled.append(rows)

    def _rectangles(self, rows: Float64Array) -> None:
        """Add rectangles of wall, all at once; empty ones are left out."""
        rows = rows[(rows[:, 1] - rows[:, 0] > 1e-6) & (rows[:, 3] - rows[:, 2] > 1e-6)]
        u, z = rows[:, [0, 1, 1, 0]], rows[:, [2, 2, 3, 3]]
        shade = _shade(z, self.wall.top_m)[..., None]
        uv = np.stack([u + self.wall.offset_m % FACADE_REPEAT_M, z], axis=-1)
        self.faces.quads(self.style.wall, self.wall.points(u, z), rows[:, None, 4:] * shade, uv=uv, roughness=0.9)

    def _plain(self, left: float, right: float, low: float, high: float, colour: Float64Array) -> None:
        cuts = sorted([low, *(cut for cut in (1.5, self.wall.top_m - 0.8) if low < cut < high), high])
        for bottom, top in pairwise(cuts):
            if self.detail is HouseDetail.FULL:
                self._panelled.append(np.array([[left, right, bottom, top, *colour]]))

    def _reveals(self, u0: Float64Array, u1: Float64Array, z0: Float64Array, z1: Float64Array, depth: float) -> None:
        """The four sides between the wall's face and the filling of the opening; the upper one is in shade."""
        if self.detail is not HouseDetail.FULL:
            return
        brick = self.style.wall is FacadeTexture.BRICK
        colour = np.array((0.24, 0.12, 0.08) if brick else self.style.colour) * 0.85
        sides = np.array([[u0, u0, z0, z1], [u1, u1, z1, z0], [u0, u1, z1, z1], [u1, u0, z0, z0]])
        u, z = np.moveaxis(sides[:, [0, 0, 1, 1]], 1, 2), np.moveaxis(sides[:, [2, 2, 3, 3]], 1, 2)
        depths = np.broadcast_to(np.array([0.0, depth, depth, 0.0]), u.shape)
        shown = np.repeat(colour * SHADES_IN_REVEAL, len(u0), axis=0)[:, None]
        self.faces.quads(FacadeTexture.PLAIN, self.wall.points(u, z, depths), shown, roughness=0.9)

    def _slab(self, u: Float64Array, z: Float64Array, out: float, colour: Float64Array, roughness: float) -> None:
        """Boxes on the wall's face, (2,) or (n, 2) ends along it and heights: front, top, underside and ends."""
        if self.detail is not HouseDetail.FULL:
            return
        u, z = u.reshape(-1, 2), z.reshape(-1, 2)
        depths = np.broadcast_to(np.where(SLAB_FRONT, -out, 0.0), (len(u), *SLAB_FRONT.shape))
        corners = self.wall.points(u[:, SLAB_ENDS], z[:, SLAB_HEIGHTS], depths)
        shades = np.tile(np.clip(colour * SLAB_SHADES, 0, 0.9), (len(u), 1, 1))
        self.faces.quads(FacadeTexture.PLAIN, corners, shades, roughness=roughness)


def _floors(style: FacadeStyle, top_m: float) -> list[tuple[float, float]]:
    """Bottom and top of each storey; the rest below the eaves is plain wall."""
    usable = top_m - (0.25 if style.windows else 0.0)
    first = {GroundFloor.SHOP: SHOP_M, GroundFloor.LOBBY: LOBBY_M}.get(style.ground, style.storey_m)
    if usable < 1.35 * first:
        return [(0.0, usable)]
    above = max(1, round((usable - first) / style.storey_m))
    height = (usable - first) / above
    return [(0.0, first), *((first + k * height, first + (k + 1) * height) for k in range(above))]


def _bays(style: FacadeStyle, wall: Wall) -> Float64Array:
    """(n, 2) beginning and end of each bay; none where the wall is too short."""
    margin = min(MARGIN_M, MARGIN_SHARE * wall.length_m)
    free_m = wall.length_m - 2 * margin
    if wall.length_m < SHORTEST_M or (
        style.windows is None and not (wall.front and style.ground is GroundFloor.GARAGE)
    ):
        return np.empty((0, 2))
    count = max(1, round(free_m / style.bay_m))
    edges = margin + free_m / count * np.arange(count + 1)
    return np.stack([edges[:-1], edges[1:]], axis=1)


def _cell_uv(cells: np.ndarray[tuple[int], np.dtype[np.int64]]) -> Float64Array:
    """(n, 4, 2) corners of cells in metres of the texture, half a percent within them."""
    column, row = cells % CELLS, cells // CELLS
    inset = 0.005 * CELL_M
    left, right = column * CELL_M + inset, (column + 1) * CELL_M - inset
    low, high = row * CELL_M + inset, (row + 1) * CELL_M - inset
    return np.stack(
        [np.stack(pair, axis=1) for pair in ((left, low), (right, low), (right, high), (left, high))], axis=1
    )


def _shade(z: Float64Array, top_m: float) -> Float64Array:
    """Darker towards the foot, where dirt splashes, and just below the roof."""
    foot = SHADE_AT_FOOT + (1 - SHADE_AT_FOOT) * np.clip(z / 1.5, 0, 1)
    eaves = SHADE_BELOW_EAVES + (1 - SHADE_BELOW_EAVES) * np.clip((top_m - z) / 0.8, 0, 1)
    return np.asarray(foot * eaves)
