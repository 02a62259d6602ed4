"""The style of a town's streets: pavements, sidewalks, repairs, former markings and wires. A YAML file each."""

import json
from collections.abc import Callable, Mapping
from enum import StrEnum
from functools import cache, partial
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import AfterValidator, Field

from pavetwin.config.named import names_in, read_named
from pavetwin.config.settings import NUMBER, SOME, PlacedValueError, Settings, Share, Title, Weight, Weights
from pavetwin.errors import PaveTwinError
from pavetwin.scene.ground.styles.marking_standard import mark, marking_standard
from pavetwin.scene.ground.styles.pavement import PACKAGE, Factor, Pavement, pavement
from pavetwin.scene.ground.styles.values import ValueRange, Within, pick, whole
from pavetwin.scene.values import Finish, GroundKind

OWN: Final = "own"
"""The pavement of the street itself."""


Per100M = Annotated[float, Field(ge=0, le=50), NUMBER]


class RepairMaterials(Settings):
    """Pavements of repairs by name, or by a file next to the style, with their relative frequencies."""

    patches: Weights = Field(default_factory=lambda: {OWN: 1.0})
    """Pavements of cut-out rectangles; `own` is the street's own pavement, newer and darker or older and paler."""
    trenches: Weights = Field(default_factory=lambda: {OWN: 1.0})
    """Pavements of strips over pipes and cables, along and across."""
    connections: Share = 0.0
    """Share of the trenches along a street with branches to the kerb, where houses are connected."""
    renewed: Share = 0.0
    """Share of the patches partly covered by a later patch."""
    cold_patches: Weights = Field(default_factory=lambda: {OWN: 1.0})
    """Pavements of uncut patches with irregular outlines."""
    cold_patches_per_100_m: Per100M = 0.0
    """Number on a street of age 1; fewer on newer streets."""

    @property
    def tables(self) -> Mapping[str, Mapping[str, float]]:
        """The weights of pavements by key."""
        return {"patches": self.patches, "trenches": self.trenches, "cold_patches": self.cold_patches}


class FormerKind(StrEnum):
    """State of the markings of a former layout."""

    WORN = "worn"
    """Left to wear off: a ghost next to the current ones."""
    OVERPAINTED = "overpainted"
    """Repainted some centimetres off."""
    REMOVED = "removed"
    """Ground or blasted off: a scar in the pavement."""
    MASKED = "masked"
    """Covered with dark paint."""


class FormerMarkings(Settings):
    """Markings of an earlier layout that still show."""

    share: Share = 0.0
    """Share of the marked streets and crossings that have them."""
    kinds: Annotated[Mapping[FormerKind, Weight], Field(min_length=1), SOME] = Field(
        default_factory=lambda: dict.fromkeys(FormerKind, 1.0)
    )
    """Treatment: left to wear, repainted alongside, ground off, or covered with dark paint."""
    wear: Annotated[ValueRange, Within(0.0, 0.98)] = ValueRange(least=0.7, most=0.93)
    """Wear of paint that was left: 0 new, 1 gone."""
    beside_m: Annotated[ValueRange, Within(0.0, 0.3)] = ValueRange(least=0.03, most=0.12)
    """Distance of repainted lines from the old ones."""
    moved_m: Annotated[ValueRange, Within(0.0, 3.0)] = ValueRange(least=0.25, most=0.8)
    """Distance of all other old lines from today's."""
    removed_tone: Annotated[ValueRange, Within(0.3, 1.8)] = ValueRange(least=0.84, most=1.16)
    """Factor on the pavement's reflectance where markings were ground off."""
    masked_tone: Annotated[ValueRange, Within(0.3, 1.8)] = ValueRange(least=0.5, most=0.72)
    """Factor on the pavement's reflectance where markings were covered."""


class Overhead(Settings):
    """Objects over streets that throw thin shadows on them."""

    wired: Share = 0.0
    """Share of the streets with poles that have wires between them."""
    wires: Annotated[ValueRange, Within(1, 6), AfterValidator(whole)] = ValueRange(least=1, most=4)
    """Number of wires on the poles of one street."""
    diameter_m: Annotated[ValueRange, Within(0.005, 0.08)] = ValueRange(least=0.012, most=0.03)
    """Diameter of a wire; bundles of insulated wires are the thickest."""
    sag: Annotated[ValueRange, Within(0.0, 0.06)] = ValueRange(least=0.01, most=0.03)
    """Sag at mid-span, relative to the span."""
    connections: Share = 0.0
    """Share of the poles with a wire to a house, mostly across the street."""
    bare_trees: Share = 0.0
    """Share of the trees without leaves."""


class SidewalkPaving(StrEnum):
    """Detail textures of sidewalks."""

    SLABS = "slabs"  # Of concrete, 400 mm
    CONCRETE = "concrete"  # Poured, with joints every 2 m
    BLOCKS = "blocks"  # Bricks or concrete blocks in herringbone bond
    TILES = "tiles"  # Of concrete, 250 mm, with grooves
    SETTS = "setts"  # Of granite, in courses

    @property
    def ground(self) -> GroundKind:
        return _GROUND[self]


_GROUND: Final = {
    SidewalkPaving.SLABS: GroundKind.PAVING,
    SidewalkPaving.CONCRETE: GroundKind.CONCRETE,
    SidewalkPaving.BLOCKS: GroundKind.BLOCKS,
    SidewalkPaving.TILES: GroundKind.TILES,
    SidewalkPaving.SETTS: GroundKind.SETTS,
}

COLOURED: Final = frozenset({SidewalkPaving.BLOCKS, SidewalkPaving.TILES})
"""Made with iron oxide or of clay in some streets."""

RED: Final = (1.38, 0.66)
"""Factors on red and blue of pieces of clay or iron oxide; ours, after photographs from drones."""

RED_TONE: Final = 0.8  # Factor on their reflectance


class SidewalkStyle(Settings):
    """Paving of sidewalks, street by street."""

    pavings: Annotated[Mapping[SidewalkPaving, Weight], Field(min_length=1), SOME] = {SidewalkPaving.SLABS: 1}
    """Concrete slabs (400 mm), poured concrete, blocks in herringbone bond, grooved tiles (250 mm), granite setts."""
    red: Share = 0.0
    """Share of the streets with blocks or tiles whose paving is red."""
    tone: Annotated[ValueRange, Within(0.4, 1.6)] = ValueRange(least=1.0, most=1.0)
    """Reflectance relative to the mean of the paving."""

    def surface(self, paving: float, colour: float, tone: float) -> tuple[GroundKind, Finish]:
        """Paving of a street's sidewalks, for three random numbers 0 … 1."""
        found = pick(self.pavings, paving)
        red = found in COLOURED and colour < self.red
        factors = (*(RED if red else (1.0, 1.0)), 1.0, self.tone.at(tone) * (RED_TONE if red else 1.0))
        return found.ground, Finish.rounded(*factors)


DEFAULT_STYLE: Final = "varied"

CoverName = Literal["cover_iron", "cover_filled", "cover_square", "cover_collared"]
GrateName = Literal["grate", "grate_slots"]
JointName = Literal["joint_comb", "joint_strip", "plug"]


class Stretches(Settings):
    """Parts of streets that were resurfaced later than the rest."""

    share: Share = 0.3
    """Share of the segments of at least 45 m that have such a stretch."""
    pavements: Weights
    """Pavements of the stretches."""


class Dirt(Settings):
    """Dirt on carriageways, as factors on the defaults (`distractors`)."""

    sand: Factor = 1.0
    """Sand along kerbs."""
    water: Factor = 1.0
    """Damp at kerbs and grates, and tide marks of puddles."""
    tyre_marks: Factor = 1.0
    """Tyre marks from braking and turning."""
    oil: Factor = 1.0
    """Oil in the middle of lanes and where vehicles wait."""
    leaves: Factor = 1.0
    """Leaves on carriageways and along kerbs."""
    plants: Factor = 1.0
    """Grass and moss at the kerbs of worn streets and in the joints of worn slabs."""


class StreetStyle(Settings):
    """The style of a town's streets."""

    title: Title
    """Name in messages."""
    main: Weights
    """Pavements of main streets, by name or by file."""
    other: Weights
    """Pavements of all other streets."""
    stretches: Stretches
    """Parts of streets resurfaced later than the rest."""
    repairs: RepairMaterials = RepairMaterials()
    """Materials of repairs."""
    sidewalks: SidewalkStyle = SidewalkStyle()
    """Paving of sidewalks, per street."""
    former_markings: FormerMarkings = FormerMarkings()
    """Visible markings of an earlier layout."""
    overhead: Overhead = Overhead()
    """Objects above streets that cast thin shadows."""
    dirt: Dirt = Dirt()
    """Dirt on carriageways, relative to the usual amount for the street's age."""
    paint_wear: Factor = 1.0
    """Wear of markings, relative to the usual wear for the street's age."""
    covers: Annotated[Mapping[CoverName, Weight], Field(min_length=1), SOME] = {"cover_iron": 1, "cover_filled": 1}
    """Kinds of manhole covers; most covers of a town share one kind."""
    grates: Annotated[Mapping[GrateName, Weight], Field(min_length=1), SOME] = {"grate": 1}
    """Kinds of gully grates; a town has one kind."""
    bridge_joints: Annotated[Mapping[JointName, Weight], Field(min_length=1), SOME] = {"joint_strip": 1, "plug": 1}
    """Joints at the ends of bridges: steel fingers, a rubber profile between steel edges, or an asphalt plug."""
    litter_per_100_m: Annotated[float, Field(ge=0, le=100), NUMBER] = 0.0
    """Mean number of pieces of paper, cans, bags and sticks per 100 m."""
    marks: Mapping[str, Annotated[float, Field(ge=0, le=50), NUMBER]] = Field(default_factory=dict)
    """Painted marks, by name or by file: mean number per 100 m of a street that may have them."""
    markings: str | None = None
    """Marking standard, by name or by file; the standard of the place without it."""

    def pavement(self, *, main: bool, chance: float, slabs: bool = True) -> Pavement:
        """The pavement of a street for a random number 0 … 1; pavements of slabs have the lowest.

        Args:
            main: whether it is a main street.
            chance: the random number.
            slabs: False for none of slabs, if the style has others.
        """
        table = self.main if main else self.other
        ordered = sorted(table, key=lambda name: pavement(name).slabs is None)
        if not slabs and any(table[name] > 0 and pavement(name).slabs is None for name in table):
            ordered = [name for name in ordered if pavement(name).slabs is None]
        return pavement(pick({name: table[name] for name in ordered}, chance))


def style_names() -> list[str]:
    """The styles that ship with the package."""
    return names_in(PACKAGE, "streets")


@cache
def street_style(name: str) -> StreetStyle:
    """The style of a name, or of a YAML file of the user's own, which may name files next to it.

    Raises:
        PaveTwinError: there is no such style or file, the file is none, or it names a pavement, mark or marking
            standard that is none.
    """
    found = read_named(
        StreetStyle,
        name,
        what="street style",
        key="style",
        package=PACKAGE,
        folder="streets",
        check=partial(check_parts, name=name),
    )

    def beside(table: Mapping[str, float]) -> dict[str, float]:
        return {_beside(name, each): value for each, value in table.items()}

    repaired = {key: beside(table) for key, table in found.repairs.tables.items()}
    update: dict[str, Any] = {
        "main": beside(found.main),
        "other": beside(found.other),
        "stretches": found.stretches.model_copy(update={"pavements": beside(found.stretches.pavements)}),
        "repairs": found.repairs.model_copy(update=repaired),
        "marks": beside(found.marks),
        "markings": None if found.markings is None else _beside(name, found.markings),
    }
    return found.model_copy(update=update)


def check_parts(style: StreetStyle, name: str) -> None:
    """Refuse a style that names what is not there.

    Args:
        name: its own, or its file; files that it names lie next to it.

    Raises:
        PlacedValueError: a pavement, mark or marking standard that it names is none.
    """
    tables = {("main",): style.main, ("other",): style.other, ("stretches", "pavements"): style.stretches.pavements}
    tables |= {("repairs", key): weights for key, weights in style.repairs.tables.items()}
    parts: list[tuple[tuple[str, ...], str, Callable[[str], object]]] = [
        (path, each, pavement)
        for path, weights in tables.items()
        for each in weights
        if not (path[0] == "repairs" and each == OWN)
    ]
    parts += [(("marks",), each, mark) for each in style.marks]
    parts += [(("markings",), style.markings, marking_standard)] if style.markings is not None else []
    for path, each, read in parts:
        try:
            read(_beside(name, each))
        except PaveTwinError as error:
            raise PlacedValueError((*path, each), str(error), named=False) from error


def style_sha256(name: str) -> str:
    """SHA-256 of a style with the pavements, marks and marking standard that it names."""
    style = street_style(name)
    tables = (style.main, style.other, style.stretches.pavements, *style.repairs.tables.values())
    named: dict[str, Any] = {
        "main": True,
        "other": True,
        "stretches": True,
        "marks": True,
        "repairs": set(style.repairs.tables),
    }
    said = style.model_dump(mode="json", exclude=named)
    if style.markings is not None:
        said["markings"] = marking_standard(style.markings).model_dump(mode="json", exclude={"areas"})
    told = [said, style.stretches.share]
    told += [[(weight, _told(each)) for each, weight in table.items()] for table in tables]
    told += [(rate, mark(each).model_dump(mode="json")) for each, rate in style.marks.items()]
    return sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()


def _told(name: str) -> str | dict[str, Any]:
    return OWN if name == OWN else pavement(name).model_dump(mode="json")


def _beside(style: str, name: str) -> str:
    """The name of a part of a style; a file name is relative to the style's folder."""
    return str(Path(style).parent / name) if name.endswith((".yaml", ".yml")) else name
