"""Condition index of the inspected segments: the true one, and the one of the defects found."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import polars as pl

from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.mission.folder import MissionFolder
from pavetwin.mission.inputs import check_unchanged, defects_of, world_of
from pavetwin.pci import Survey, UnitCondition, mean_pci, not_counted, rating_of, sample_units
from pavetwin.world.layers import columns_of, write_layer
from pavetwin.world.model import Defect, World

WORST_FIRST: Final = "pci"


@dataclass(frozen=True)
class ConditionReport:
    """Condition of sample units: true and, where a mission inspected them, as found."""

    world: World
    true: tuple[UnitCondition, ...]
    found: tuple[UnitCondition, ...] | None
    """Condition of the same units with the defects found alone; None without a mission."""
    not_counted: Mapping[str, int]
    """Number of defects that stand for no distress of the standard, by class."""
    defects: tuple[Defect, ...]
    """The defects in these units."""
    detected: tuple[UnitCondition, ...] | None = None
    """Condition of the same units by measured sizes; None without any (`pavetwin.inventory.condition`)."""

    @property
    def pci(self) -> float:
        return mean_pci(self.true)

    @property
    def pci_found(self) -> float | None:
        return None if self.found is None else mean_pci(self.found)

    @property
    def pci_detected(self) -> float | None:
        return None if self.detected is None else mean_pci(self.detected)


def condition_of_world(world: World) -> ConditionReport:
    """The true condition of a whole world."""
    true = Survey(sample_units(world.segments), world.defects).conditions()
    return ConditionReport(world, true, None, not_counted(world.defects), world.defects)


def condition_of_mission(mission: MissionFolder) -> ConditionReport:
    """The condition of the segments that a mission inspected.

    Raises:
        PaveTwinError: its world has changed, or its `captures.geojson` is missing or damaged.
    """
    if mission.captures is None:
        raise PaveTwinError(f"'{mission.folder}' has no captures.geojson, or a damaged one; fly it again.")
    world = world_of(mission.spec.world)
    check_unchanged(mission.spec, world)
    targets = [world.segment(name) for name in mission.spec.targets]
    inspected = {segment.id for segment in targets}
    placed = defects_of(world, mission.spec.defects, mission.spec.targets)
    defects = tuple(defect for defect in placed if defect.segment in inspected)
    survey = Survey(sample_units(targets), defects)
    try:
        found = [int(feature["id"]) for feature in mission.captures["features"]]
    except (KeyError, TypeError, ValueError) as error:
        raise PaveTwinError(f"'{mission.folder / 'captures.geojson'}' is damaged; fly the mission again.") from error
    return ConditionReport(world, survey.conditions(), survey.conditions(found), not_counted(defects), defects)


def unit_table(report: ConditionReport) -> pl.DataFrame:
    """Table of sample units, one row per unit.

    Columns: `unit`, `segment`, `street`, `area_m2`, `pci`, `rating`, for missions `pci_found` and `rating_found`, where
    their sensor measured also `pci_detected` and `rating_detected`, and the quantity of each distress and severity that
    occurs, as `alligator_cracking_low_m2`.
    """
    rows = []
    for number, condition in enumerate(report.true):
        unit, found = condition.unit, report.found[number] if report.found else None
        detected = report.detected[number] if report.detected else None
        rows.append(
            {
                "unit": unit.id,
                "segment": unit.segment.id,
                "street": unit.segment.street_name,
                "area_m2": round(unit.area_m2, 1),
                **_index(condition.pci, ""),
                **(_index(found.pci, "_found") if found else {}),
                **(_index(detected.pci, "_detected") if detected else {}),
                **{
                    f"{deduct.distress}_{deduct.severity}_{deduct.distress.unit.replace('²', '2')}": deduct.quantity
                    for deduct in condition.deducts
                },
            }
        )
    table = pl.DataFrame(rows, infer_schema_length=None)
    extents = [name for name in table.columns if name.endswith(("_m2", "_m", "_number")) and name != "area_m2"]
    return table.with_columns(pl.col(extents).fill_null(0.0).round(3))


def street_condition(report: ConditionReport) -> pl.DataFrame:
    """Table of streets, one row per street, the worst first.

    Columns: `street`, `units`, `area_m2`, `pci`, `rating`, `worst_unit`, `worst_pci`, and the columns `_found` and
    `_detected` of `unit_table`.
    """
    grouped: dict[str, list[int]] = {}
    for number, condition in enumerate(report.true):
        grouped.setdefault(condition.unit.segment.street_name, []).append(number)
    rows = [_street(report, street, numbers) for street, numbers in grouped.items()]
    return pl.DataFrame(rows, infer_schema_length=None).sort(WORST_FIRST)


def _street(report: ConditionReport, street: str, numbers: Sequence[int]) -> dict[str, Any]:
    true = [report.true[number] for number in numbers]
    worst = min(true, key=lambda condition: condition.pci)
    return {
        "street": street,
        "units": len(true),
        "area_m2": round(sum(condition.unit.area_m2 for condition in true), 1),
        **_index(mean_pci(true), ""),
        "worst_unit": worst.unit.id,
        "worst_pci": round(worst.pci, 1),
        **(_index(mean_pci([report.found[number] for number in numbers]), "_found") if report.found else {}),
        **(_index(mean_pci([report.detected[number] for number in numbers]), "_detected") if report.detected else {}),
    }


def _index(pci: float, ending: str) -> dict[str, Any]:
    return {f"pci{ending}": round(pci, 1), f"rating{ending}": rating_of(pci).value}


def write_condition(report: ConditionReport, folder: Path) -> None:
    """Write `units.csv`, `streets.csv` and `pci.gpkg`, whose layer `sample_units` has the units' outlines.

    Raises:
        OSError: the disk is full or the folder cannot be written.
    """
    table = unit_table(report)
    with writing(folder / "units.csv") as temporary:
        table.write_csv(temporary)
    with writing(folder / "streets.csv") as temporary:
        street_condition(report).write_csv(temporary)
    with writing(folder / "pci.gpkg") as temporary:
        write_units(report, table, temporary)


def write_units(report: ConditionReport, table: pl.DataFrame, path: Path) -> None:
    """Add the layer `sample_units`, the units' outlines with the columns of `unit_table`, to a GeoPackage.

    Raises:
        OSError: the disk is full or the folder cannot be written.
    """
    columns, masks = columns_of(table)
    outlines = [condition.unit.polygon for condition in report.true]
    write_layer(path, "sample_units", "MultiPolygon", outlines, columns, report.world.georeference, masks)
