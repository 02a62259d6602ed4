"""Type and façade style of a building from its size, height and neighbours, and the level of detail of buildings."""

from dataclasses import dataclass, replace
from enum import Enum, IntEnum, auto

import numpy as np

from pavetwin.scene.buildings.layers import FacadeTexture
from pavetwin.scene.palettes import Colour


class HouseDetail(IntEnum):
    """All levels have the same walls, roofs and random choices."""

    FULL = 0
    """Openings set back into their walls, with reveals and sills; cornices, eaves, ridges."""
    FLAT = 1
    """Openings lie on their walls; roofs without eaves and ridge tiles."""
    BLANK = 2
    """Walls without openings; roofs without equipment, hipped ones in wide steps."""


class Roof(Enum):
    FLAT = auto()
    PITCHED = auto()


class GroundFloor(Enum):
    """Use of the ground floor's front."""

    HOME = auto()
    SHOP = auto()
    GARAGE = auto()
    HALL = auto()
    LOBBY = auto()


@dataclass(frozen=True, slots=True)
class Windows:
    """The openings of a façade: one per bay and storey."""

    layer: FacadeTexture
    cells: tuple[int, ...]
    """Cells of the layer, of which each window draws one."""
    width: float
    """Width as a share of the bay."""
    height: float
    """Height as a share of the storey."""
    sill: float
    """Height of the sill as a share of the storey."""
    reveal_m: float
    """Depth of the reveal in the wall."""
    with_sill: bool


@dataclass(frozen=True, slots=True)
class FacadeStyle:
    wall: FacadeTexture
    colour: Colour
    trim: Colour
    """Colour of sills, cornices and string courses."""
    plinth: Colour
    storey_m: float
    bay_m: float
    windows: Windows | None
    """None for walls without any."""
    ground: GroundFloor
    roof: Roof = Roof.FLAT
    covering: FacadeTexture = FacadeTexture.FELT
    covering_colour: Colour = (1.0, 1.0, 1.0)
    pitch_rad: float = 0.0
    cornice: bool = False
    """A moulding below the roof and a string course over the ground floor."""


@dataclass(frozen=True, slots=True)
class Situation:
    """Properties of a building besides its height."""

    area_m2: float
    height_m: float
    street_m: float
    """Distance from the nearest carriageway."""
    joined: bool
    """Whether another building touches it."""
    long_m: float
    """Length of its longest side."""


TOWER = 2.2
"""A building higher than this many times the side of a square of its area is a tower."""

RENDERS: tuple[Colour, ...] = (
    (0.68, 0.66, 0.60), (0.66, 0.60, 0.47), (0.60, 0.50, 0.33), (0.55, 0.42, 0.30), (0.62, 0.58, 0.54),
    (0.50, 0.50, 0.47), (0.47, 0.53, 0.50), (0.58, 0.45, 0.40), (0.70, 0.69, 0.67), (0.42, 0.33, 0.24),
)  # fmt: skip
BRICKS: tuple[Colour, ...] = ((1.0, 1.0, 1.0), (1.25, 1.2, 1.1), (0.75, 0.70, 0.72), (1.5, 1.75, 1.7), (1.1, 0.85, 0.8))
CLADDINGS: tuple[Colour, ...] = ((0.55, 0.57, 0.58), (0.30, 0.34, 0.38), (0.45, 0.42, 0.36), (0.20, 0.28, 0.24))
TILE_TONES: tuple[Colour, ...] = ((1.0, 1.0, 1.0), (0.75, 0.72, 0.75), (1.25, 1.3, 1.3), (0.55, 0.62, 0.75))
WHITE: Colour = (0.68, 0.67, 0.64)


def style_of(situation: Situation, rng: np.random.Generator) -> FacadeStyle:
    """The style of a building."""
    if situation.height_m > TOWER * np.sqrt(situation.area_m2):
        return _tower(rng)
    if situation.height_m <= 3.6 and situation.area_m2 < 60:
        return _garage(rng)
    if situation.height_m <= 5.6:
        return _shed(rng)
    if situation.area_m2 > 420:
        return _hall(rng) if situation.height_m < 9.8 and rng.random() < 0.4 else _block(situation, rng)
    return _house(situation, rng)


def _pick(colours: tuple[Colour, ...], rng: np.random.Generator, spread: float = 0.06) -> Colour:
    red, green, blue = colours[int(rng.integers(len(colours)))]
    factor = float(np.exp(spread * np.clip(rng.standard_normal(), -2, 2)))
    return min(red * factor, 0.85) if red < 0.9 else red * factor, green * factor, blue * factor


def _dark(colour: Colour, share: float = 0.55) -> Colour:
    return colour[0] * share, colour[1] * share, colour[2] * share


def _house(situation: Situation, rng: np.random.Generator) -> FacadeStyle:
    town = situation.height_m > 8.8
    brick = rng.random() < 0.28
    colour = _pick(BRICKS, rng) if brick else _pick(RENDERS, rng)
    shop = town and situation.street_m < 7.5 and rng.random() < 0.6
    family = (0, 8, 12)[int(rng.choice(3, p=[0.72, 0.18, 0.10]))]
    count = 8 if family == 0 else 4
    cells = tuple(family + int(n) for n in rng.choice(count, size=3 + int(rng.integers(3)), replace=True))
    tiles = rng.random() < 0.62
    return FacadeStyle(
        wall=FacadeTexture.BRICK if brick else FacadeTexture.RENDER,
        colour=colour,
        trim=WHITE if rng.random() < 0.6 else (0.45, 0.44, 0.41),
        plinth=(0.26, 0.25, 0.24) if brick else _dark(colour),
        storey_m=3.05 if town else 2.75,
        bay_m=float(rng.uniform(2.5, 3.3)),
        windows=Windows(
            FacadeTexture.WINDOWS, cells, rng.uniform(0.38, 0.5), rng.uniform(0.46, 0.58), 0.30, 0.13, True
        ),
        ground=GroundFloor.SHOP if shop else GroundFloor.HOME,
        roof=Roof.PITCHED,
        covering=FacadeTexture.TILES if tiles else FacadeTexture.SLATE,
        covering_colour=_pick(TILE_TONES, rng, 0.12) if tiles else _pick(((1.0, 1.0, 1.0),), rng, 0.2),
        pitch_rad=float(np.radians(rng.uniform(32, 44))),
        cornice=town,
    )


def _block(situation: Situation, rng: np.random.Generator) -> FacadeStyle:
    """Offices, schools, blocks of flats."""
    kind = int(rng.integers(3))
    wall = (FacadeTexture.RENDER, FacadeTexture.CONCRETE, FacadeTexture.STONE)[kind]
    colour = _pick(RENDERS, rng) if kind == 0 else _pick(((0.50, 0.49, 0.46), (0.58, 0.54, 0.46)), rng)
    ribbon = kind > 0 and rng.random() < 0.6
    windows = (
        Windows(FacadeTexture.GLAZING, tuple(range(8)), 0.97, 0.55, 0.30, 0.10, False)
        if ribbon
        else Windows(FacadeTexture.WINDOWS, (8, 9, 10, 11, 8, 11), 0.55, 0.56, 0.28, 0.18, True)
    )
    near = situation.street_m < 9.0
    return FacadeStyle(
        wall=wall,
        colour=colour,
        trim=_dark(colour, 0.8),
        plinth=_dark(colour),
        storey_m=3.4,
        bay_m=float(rng.uniform(2.2, 3.4)),
        windows=windows,
        ground=GroundFloor.SHOP if near else GroundFloor.LOBBY,
        covering=FacadeTexture.GRAVEL if rng.random() < 0.6 else FacadeTexture.FELT,
    )


def _hall(rng: np.random.Generator) -> FacadeStyle:
    colour = _pick(CLADDINGS, rng)
    return FacadeStyle(
        wall=FacadeTexture.CLADDING,
        colour=colour,
        trim=_dark(colour, 0.7),
        plinth=(0.30, 0.29, 0.28),
        storey_m=4.4,
        bay_m=4.5,
        windows=Windows(FacadeTexture.GLAZING, (0, 1, 4, 5), 0.9, 0.22, 0.68, 0.05, False),
        ground=GroundFloor.HALL,
        covering=FacadeTexture.FELT if rng.random() < 0.5 else FacadeTexture.SEAMS,
    )


def _shed(rng: np.random.Generator) -> FacadeStyle:
    style = _hall(rng)
    wall = FacadeTexture.BRICK if rng.random() < 0.4 else FacadeTexture.RENDER
    colour = _pick(BRICKS, rng) if wall is FacadeTexture.BRICK else _pick(RENDERS, rng)
    windows = Windows(FacadeTexture.WINDOWS, (8, 9, 11), 0.42, 0.30, 0.42, 0.1, True)
    covering = FacadeTexture.FELT
    style = replace(style, wall=wall, colour=colour, plinth=_dark(colour), covering=covering)
    return replace(style, storey_m=6.0, bay_m=3.2, windows=windows)


def _garage(rng: np.random.Generator) -> FacadeStyle:
    colour = _pick(RENDERS, rng)
    return FacadeStyle(
        wall=FacadeTexture.RENDER,
        colour=colour,
        trim=(0.2, 0.2, 0.2),
        plinth=_dark(colour),
        storey_m=6.0,
        bay_m=3.0,
        windows=None,
        ground=GroundFloor.GARAGE,
    )


def _tower(rng: np.random.Generator) -> FacadeStyle:
    colour = _pick(((0.52, 0.48, 0.40), (0.60, 0.57, 0.50)), rng)
    return FacadeStyle(
        wall=FacadeTexture.STONE,
        colour=colour,
        trim=_dark(colour, 0.8),
        plinth=_dark(colour, 0.7),
        storey_m=9.0,
        bay_m=7.0,
        windows=Windows(FacadeTexture.WINDOWS, (11,), 0.16, 0.3, 0.4, 0.25, True),
        ground=GroundFloor.LOBBY,
        roof=Roof.PITCHED,
        covering=FacadeTexture.SLATE,
        pitch_rad=float(np.radians(58)),
        cornice=True,
    )
