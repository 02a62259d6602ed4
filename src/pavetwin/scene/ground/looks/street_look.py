"""The look of a town's streets: which pavements they have, and what lies on them. A YAML file each."""

import json
from collections.abc import Callable, Mapping
from functools import cache, partial
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import Field

from pavetwin.config.named import names_in, read_named
from pavetwin.config.settings import NUMBER, SOME, PlacedValueError, Settings, Share, Title, Weight, Weights
from pavetwin.errors import PaveTwinError
from pavetwin.scene.ground.looks.history import OWN, FormerMarkings, RepairMaterials
from pavetwin.scene.ground.looks.mark import mark
from pavetwin.scene.ground.looks.marking_standard import marking_standard
from pavetwin.scene.ground.looks.overhead import Overhead
from pavetwin.scene.ground.looks.pavement import PACKAGE, Factor, Pavement, pavement
from pavetwin.scene.ground.looks.sidewalks import SidewalkLook
from pavetwin.scene.ground.looks.weights import pick

DEFAULT_LOOK: Final = "varied"

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
    """What lies on carriageways, × what the twin assumes of a street (`distractors`)."""

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


class StreetLook(Settings):
    """The look of a town's streets."""

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
    sidewalks: SidewalkLook = SidewalkLook()
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
            slabs: False for none of slabs, if the look has others.
        """
        table = self.main if main else self.other
        ordered = sorted(table, key=lambda name: pavement(name).slabs is None)
        if not slabs and any(table[name] > 0 and pavement(name).slabs is None for name in table):
            ordered = [name for name in ordered if pavement(name).slabs is None]
        return pavement(pick({name: table[name] for name in ordered}, chance))


def look_names() -> list[str]:
    """The looks that ship with the package."""
    return names_in(PACKAGE, "streets")


@cache
def street_look(name: str) -> StreetLook:
    """The look of a name, or of a YAML file of the user's own, which may name files beside it.

    Raises:
        PaveTwinError: there is no such look or file, the file is none, or it names a pavement, mark or marking
            standard that is none.
    """
    found = read_named(
        StreetLook,
        name,
        what="street look",
        key="look",
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


def check_parts(look: StreetLook, name: str) -> None:
    """Refuse a look that names what is not there.

    Args:
        name: its own, or its file; files that it names lie beside it.

    Raises:
        PlacedValueError: a pavement, mark or marking standard that it names is none.
    """
    tables = {("main",): look.main, ("other",): look.other, ("stretches", "pavements"): look.stretches.pavements}
    tables |= {("repairs", key): weights for key, weights in look.repairs.tables.items()}
    parts: list[tuple[tuple[str, ...], str, Callable[[str], object]]] = [
        (path, each, pavement)
        for path, weights in tables.items()
        for each in weights
        if not (path[0] == "repairs" and each == OWN)
    ]
    parts += [(("marks",), each, mark) for each in look.marks]
    parts += [(("markings",), look.markings, marking_standard)] if look.markings is not None else []
    for path, each, read in parts:
        try:
            read(_beside(name, each))
        except PaveTwinError as error:
            raise PlacedValueError((*path, each), str(error), named=False) from error


def look_sha256(name: str) -> str:
    """SHA-256 of all that a look says, the pavements, marks and marking standard that it names included."""
    look = street_look(name)
    tables = (look.main, look.other, look.stretches.pavements, *look.repairs.tables.values())
    named: dict[str, Any] = {
        "main": True,
        "other": True,
        "stretches": True,
        "marks": True,
        "repairs": set(look.repairs.tables),
    }
    said = look.model_dump(mode="json", exclude=named)
    if look.markings is not None:
        said["markings"] = marking_standard(look.markings).model_dump(mode="json", exclude={"areas"})
    told = [said, look.stretches.share]
    told += [[(weight, _told(each)) for each, weight in table.items()] for table in tables]
    told += [(rate, mark(each).model_dump(mode="json")) for each, rate in look.marks.items()]
    return sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()


def _told(name: str) -> str | dict[str, Any]:
    return OWN if name == OWN else pavement(name).model_dump(mode="json")


def _beside(look: str, name: str) -> str:
    """The name of a part of a look; where it is a file, the one beside the look's."""
    return str(Path(look).parent / name) if name.endswith((".yaml", ".yml")) else name
