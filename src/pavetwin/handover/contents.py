"""The contents of a handover, read from a mission's folder and checked before any file is written."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import polars as pl
import polars.selectors as cs

from pavetwin.errors import PaveTwinError
from pavetwin.experiments.units import SHOWN, content_of
from pavetwin.flightplan import FlightPlan, Trigger, plan_of
from pavetwin.handover.of_study import StreetAdvice
from pavetwin.inventory.condition import with_detected
from pavetwin.inventory.of_mission import flown
from pavetwin.inventory.reading import Reading, has_sizes
from pavetwin.mission.condition import ConditionReport, condition_of_mission, street_condition, unit_table
from pavetwin.mission.folder import MissionFolder
from pavetwin.mission.inspected_defects import MissReason
from pavetwin.policies import policy_class
from pavetwin.world.model import Defect, World

DEFECTS: Final = "defects.csv"
STREETS: Final = "streets.csv"

DEFECT_COLUMNS: Final[Mapping[str, Any]] = {
    **{"id": pl.Int64, "class": pl.String, "severity": pl.String, "outcome": pl.String, "reason": pl.String},
    **{"street": pl.String, "segment": pl.String},
    **dict.fromkeys(("length_m", "width_m", "depth_m", "area_m2", "longitude", "latitude"), pl.Float64),
}
"""Columns of the handover's table of defects, taken from a mission's `defects.csv`."""

_STREET_COLUMNS: Final[Mapping[str, Any]] = {
    **{"street": pl.String, "segments": pl.String, "length_m": pl.Float64, "area_m2": pl.Float64},
    **{"defects": pl.Int64, "found": pl.Int64, "surface_coverage": pl.Float64, "time_s": pl.Float64},
}
"""Taken from a mission's `streets.csv`."""

_CONDITION_COLUMNS: Final = ("units", "pci", "rating", "pci_found", "rating_found", "worst_unit", "worst_pci")


@dataclass(frozen=True)
class Handover:
    """A mission, what it found, and what is flown for it."""

    name: str
    """Name of the mission, or of the study that recommends it."""
    mission: MissionFolder
    world: World
    plan: FlightPlan
    condition: ConditionReport
    shapes: Sequence[Defect]
    """Defects of the rows of `defects`."""
    defects: pl.DataFrame
    """A row a defect of the inspected segments: `DEFECT_COLUMNS`."""
    units: pl.DataFrame
    """A row a sample unit, as `unit_table` makes it."""
    streets: pl.DataFrame
    """A row a street, the worst first: length, defects and found ones, what was seen, condition; of a study also what
    to fly there (`StreetAdvice`)."""
    reading: Reading
    """Detections of the mission's sensor."""
    advice: StreetAdvice | None = None

    @property
    def measured(self) -> bool:
        """True if the sensor measured sizes, as on a real flight."""
        return has_sizes(self.reading.detections)

    @property
    def policy(self) -> str:
        return policy_class(self.mission.spec.policy.name).name

    @property
    def pci_found(self) -> float:
        assert self.condition.pci_found is not None
        return self.condition.pci_found

    @property
    def by_segment(self) -> tuple[list[int], list[int]]:
        """Numbers of found and of all defects of each segment with defects."""
        counted = self.defects.group_by("segment", maintain_order=True).agg(
            (pl.col("outcome") == "found").sum().alias("found"), pl.len().alias("defects")
        )
        return counted["found"].to_list(), counted["defects"].to_list()

    @property
    def found(self) -> int:
        return int((self.defects["outcome"] == "found").sum())

    @property
    def missed(self) -> int:
        return self.defects.height - self.found

    @property
    def reasons(self) -> Mapping[MissReason | None, int]:
        """Number of missed defects for each reason."""
        counted = self.defects["reason"].drop_nulls().value_counts().rows()
        return {MissReason(reason): count for reason, count in counted}

    def by_severity(self) -> pl.DataFrame:
        """A row a class and severity that occurs: `class`, `severity`, `defects`, `found`, `missed`."""
        order = {"low": 0, "medium": 1, "high": 2}
        return (
            self.defects.group_by("class", "severity")
            .agg(
                pl.len().alias("defects"),
                (pl.col("outcome") == "found").sum().alias("found"),
                (pl.col("outcome") == "missed").sum().alias("missed"),
            )
            .sort("class", pl.col("severity").replace_strict(order, default=3))
        )


def handover_of(
    mission: MissionFolder,
    *,
    name: str = "",
    trigger: Trigger = Trigger.DISTANCE,
    advice: StreetAdvice | None = None,
) -> Handover:
    """Gather the handover of a mission.

    Args:
        name: what it is called; as the mission's folder unless given.
        trigger: what releases the camera in the plans.
        advice: of a study over the same world.

    Raises:
        PaveTwinError: the world or a file of the mission is missing, damaged or has changed, its files contradict each
            other, or the world is not georeferenced.
    """
    folder, condition = mission.folder, condition_of_mission(mission)
    reading = flown(mission, frame=condition.world.georeference)
    condition = with_detected(condition, reading)
    world = condition.world
    if advice is not None:
        _check_world(advice, world)
    plan = plan_of(mission, world, trigger=trigger)
    defects = _table(folder / DEFECTS, DEFECT_COLUMNS)
    streets = _table(folder / STREETS, _STREET_COLUMNS)
    shapes = _matched(mission, defects, condition)
    _check_streets(folder / STREETS, streets, defects)
    whole = streets.with_columns((pl.col("defects") - pl.col("found")).alias("missed")).join(
        street_condition(condition).select("street", *_CONDITION_COLUMNS, cs.ends_with("_detected")),
        on="street",
        how="left",
    )
    if advice is not None:
        whole = whole.join(advice.table, on="street", how="left")
    return Handover(
        *(name or mission.name, mission, world, plan, condition, shapes, defects),
        units=unit_table(condition),
        streets=whole.sort("pci", "street"),
        reading=reading,
        advice=advice,
    )


def _check_world(advice: StreetAdvice, world: World) -> None:
    """Raises:
    PaveTwinError: the study flew over another world than the mission.
    """
    if advice.world != world.name:
        raise PaveTwinError(f"`study`: it has no missions in the world '{world.name}' of the mission.")
    now = content_of(world, with_defects=advice.of_defects)[:SHOWN]
    if advice.content and advice.content != now:
        raise PaveTwinError(
            f"`study`: its world '{world.name}' ({advice.content}) is not that of the mission ({now}), though it has "
            "the same name; name a study over the mission's world."
        )


def _table(path: Path, columns: Mapping[str, Any]) -> pl.DataFrame:
    """Raises:
    PaveTwinError: the file is missing or damaged.
    """
    try:
        table = pl.read_csv(path, schema_overrides=dict(columns), infer_schema_length=0)
    except (OSError, pl.exceptions.PolarsError) as error:
        raise PaveTwinError(f"'{path}' is missing or damaged; fly the mission again.") from error
    if gone := [name for name in columns if name not in table.columns]:
        raise PaveTwinError(f"'{path}' has no column '{gone[0]}': it is damaged; fly the mission again.")
    return table.select(*columns)


def _matched(mission: MissionFolder, defects: pl.DataFrame, condition: ConditionReport) -> list[Defect]:
    """The defects of the table's rows.

    Raises:
        PaveTwinError: the table is of other defects, or of another mission than its description and its captures.
    """
    placed = {defect.id: defect for defect in condition.defects}
    found = set(defects.filter(outcome="found")["id"])
    assert mission.captures is not None
    captured = {int(feature["id"]) for feature in mission.captures["features"]}
    outcomes = set(defects["outcome"].to_list()) | {"found", "missed"}
    known = {None, *map(str, MissReason)}
    fits = (
        set(defects["id"]) == placed.keys()
        and defects.height == len(placed)
        and found == captured
        and len(found) == mission.totals.get("confirmed")
        and outcomes == {"found", "missed"}
        and set(defects["reason"].to_list()) <= known
    )
    if not fits:
        raise PaveTwinError(
            f"'{mission.folder / DEFECTS}' is not of the same mission as {mission.file.name} and captures.geojson "
            "next to it, or was changed; fly the mission again."
        )
    return [placed[number] for number in defects["id"]]


def _check_streets(path: Path, streets: pl.DataFrame, defects: pl.DataFrame) -> None:
    """Raises:
    PaveTwinError: the table counts other defects than that of defects.
    """
    counted = defects.group_by("street").agg(
        pl.len().cast(pl.Int64).alias("defects"), (pl.col("outcome") == "found").sum().cast(pl.Int64).alias("found")
    )
    there = streets.filter(pl.col("defects") > 0).select("street", "defects", "found")
    if set(counted.rows()) != set(there.rows()):
        raise PaveTwinError(f"'{path}' counts other defects than {DEFECTS} next to it; fly the mission again.")
