"""A study's folder: `design.yaml`, and the table `segments.parquet` in parts, one per flown unit.

When one of the user's own files changes, only the missions that depend on it are flown again. Their former rows move
to `former/HASH/`, named by the hash of the former files.
"""

import io
import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import Any

import numpy as np
import polars as pl
import yaml

from pavetwin.config.options import OptionValue
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.design import Design
from pavetwin.experiments.fly_unit import part_of, schema
from pavetwin.experiments.metrics import FACTORS, FAILED, FILES, RENDERER, STATUS
from pavetwin.experiments.units import EVERYONE, SHOWN, Owners, Plan, Unit, units_of
from pavetwin.files import FORMAT, check_format, writing
from pavetwin.mission.versions import renderer_of, software_versions, version_changes
from pavetwin.reports.words import listed

DESIGN, PARTS, FORMER = "design.yaml", "segments.parquet", "former"


class Store:
    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def check_design(self, design: Design) -> None:
        """Check that the folder is new, or was begun with the same design and versions. Nothing is written.

        The number of replicates may grow; the name and the comparisons may change.

        Raises:
            PaveTwinError: the folder holds something else; the message states the first difference.
        """
        if self._holds_anything():
            there = self.description()
            _check_same(self.folder, there, design)
            if there["design"]["replicates"] > design.replicates:
                raise PaveTwinError(
                    f"'{self.folder}' was begun with {there['design']['replicates']} replicates, more than "
                    f"{design.replicates}; choose another folder."
                )

    def check(self, plan: Plan) -> None:
        """Run `check_design`, and check that the study was begun over the same worlds and populations.

        Raises:
            PaveTwinError: it holds something else; the message states the first difference.
        """
        self.check_design(plan.design)
        if not self._holds_anything():
            return
        self._check_renderer()
        there, wanted = self.description()["worlds"], _description(plan, {})["worlds"]
        for name in (name for name, content in wanted.items() if there.get(name) != content):
            raise PaveTwinError(
                f"'{self.folder}' was begun with another world than '{name}' is now; choose another folder."
            )
        placed_by = self.description().get("populations", {})
        for name in (name for name, content in placed_by.items() if plan.populations.get(name) != content):
            raise PaveTwinError(
                f"'{self.folder}' was begun with the damage population '{name}' of other content than it has now; "
                "choose another folder."
            )
        _check_owners(self.folder, self.owners(), plan)

    def check_models(self, plan: Plan) -> None:
        """Compare the models of the sensors with those that the study was begun with.

        Raises:
            PaveTwinError: a sensor has another model now.
        """
        there = self.models()
        for sensor, models in plan.models.items():
            if (begun := there.get(sensor, models)) != models:
                before, now = (", ".join(map(str, each.values())) for each in (begun, models))
                raise PaveTwinError(
                    f"'{self.folder}' was begun with the model {before} of the sensor '{sensor}' (now {now}); choose "
                    "another folder."
                )

    def models(self) -> Mapping[str, Mapping[str, OptionValue]]:
        """Models used by each sensor for which the design names none."""
        return (self.description().get("models") or {}) if self._holds_anything() else {}

    def missing(self, plan: Plan, *, failed: bool = False) -> list[Unit]:
        """Units left to fly: those without an intact part, and of the others the cells that are missing or were flown
        with files that have changed since; with `failed` also those that failed."""
        return [
            replace(unit, cells=missing) if len(missing) < len(plan.cells) else unit
            for unit in plan.units
            if (missing := self._missing(plan, unit, failed=failed))
        ]

    def changed_files(self, plan: Plan) -> list[str]:
        """Names of the user's own files that have changed since the study was last begun."""
        there = self.description().get("files", {}) if self._holds_anything() else {}
        wanted = _description(plan, {})["files"]
        return [Path(path).name for path, content in wanted.items() if there.get(path, content) != content]

    def outdated(self, plan: Plan) -> int:
        """Number of missions in the table that were flown with files that have changed since."""
        count = 0
        for unit in plan.units if plan.files else ():
            if (rows := self._rows(plan, unit)) is not None:
                count += len(set(_cells(plan, unit, _outdated(plan, unit, rows))))
        return count

    def begin(self, plan: Plan) -> None:
        """Prepare the folder for a checked design, and set rows of changed files apart.

        The models that the study was begun with stay.
        """
        models = self.models() if self._holds_anything() else plan.models
        description = _description(plan, models)
        with writing(self.folder / DESIGN) as path:
            path.write_text(yaml.safe_dump(description, sort_keys=False, allow_unicode=True), encoding="utf-8")
        for unit in plan.units if plan.files else ():
            self._set_apart(plan, unit)

    def description(self) -> dict[str, Any]:
        """The content of `design.yaml`.

        Raises:
            PaveTwinError: the folder holds no study, one of another format, or a damaged file.
        """
        path = self.folder / DESIGN
        if not path.is_file():
            raise PaveTwinError(
                f"'{self.folder}' holds no study; make one with "
                f"`pavetwin experiment run DESIGN.yaml --output {quote(str(self.folder))}`."
            )
        try:
            found = yaml.safe_load(path.read_text(encoding="utf-8"))
            check_format(found["format"], f"The study '{self.folder}'")
            Design.parse(found["design"], where=str(path))
            found["versions"], found["worlds"]
        except (yaml.YAMLError, OSError, UnicodeDecodeError, KeyError, TypeError) as error:
            raise PaveTwinError(f"'{path}' is damaged; run the study into another folder.") from error
        return dict(found)

    def design(self) -> Design:
        return Design.parse(self.description()["design"], where=str(self.folder / DESIGN))

    def owners(self) -> Owners:
        """Owners of the swept settings that not all policies or sensors have."""
        return self.description().get("owners") or EVERYONE

    def write(self, plan: Plan, unit: Unit, part: bytes) -> None:
        """Write the flown cells of a unit, and keep the other cells of its part."""
        if unit.cells is not None and (there := self._rows(plan, unit)) is not None:
            rows = pl.read_parquet(io.BytesIO(part))
            new = _cells(plan, unit, rows)
            kept = there.filter([cell not in new for cell in _cells(plan, unit, there)])
            both = pl.concat([kept, rows], how="diagonal")
            both = both.select([name for name in schema(plan) if name in both.columns])
            order = np.argsort(_cells(plan, unit, both), kind="stable")
            part = part_of(both[order].rechunk())
        with writing(self._part(unit)) as path:
            path.write_bytes(part)

    def parts(self) -> list[Path]:
        """The table's files, in the order of the design.

        Raises:
            PaveTwinError: the folder holds no study, or nothing of it is flown yet.
        """
        return [self._part(unit) for unit in self._flown()]

    def table(self) -> pl.DataFrame:
        """The table of everything flown so far.

        Raises:
            PaveTwinError: nothing is flown yet, or a part is damaged.
        """
        tables = []
        for unit in self._flown():
            part = self._part(unit)
            try:
                table = pl.read_parquet(part)
            except (OSError, pl.exceptions.PolarsError) as error:
                raise PaveTwinError(f"'{part}' is damaged; run the study again, which flies it again.") from error
            if table.select("replicate", "traffic").unique().rows() != [(unit.replicate, unit.traffic)]:
                raise PaveTwinError(f"'{part}' holds another part of a study; remove it and run the study again.")
            tables.append(table)
        return pl.concat(tables, how="diagonal")

    def former(self) -> pl.DataFrame | None:
        """The rows flown with files before they changed; None if there are none."""
        parts = sorted((self.folder / FORMER).glob("*/*.parquet"))
        return pl.concat([pl.read_parquet(part) for part in parts], how="diagonal") if parts else None

    def _check_renderer(self) -> None:
        """Raises:
        PaveTwinError: the images of earlier missions have another renderer than images have now.
        """
        drawn: set[str] = set()
        for part in (self.folder / PARTS).glob("*.parquet"):
            with suppress(OSError, pl.exceptions.PolarsError):  # damaged parts are flown again
                if RENDERER in pl.read_parquet_schema(part):
                    drawn.update(pl.read_parquet(part, columns=[RENDERER])[RENDERER].drop_nulls())
        now = renderer_of(software_versions(images=True)) if drawn else None
        for renderer in sorted(drawn - {now}):
            raise PaveTwinError(f"'{self.folder}' was begun with {renderer} (now {now}); choose another folder.")

    def _rows(self, plan: Plan, unit: Unit) -> pl.DataFrame | None:
        """The flown rows of a unit; None if its part is missing or damaged."""
        try:
            rows = pl.read_parquet(self._part(unit))
        except (OSError, pl.exceptions.PolarsError):
            return None
        return rows.filter(world=plan.names[unit.world], traffic=unit.traffic, replicate=unit.replicate)

    def _missing(self, plan: Plan, unit: Unit, *, failed: bool) -> tuple[int, ...]:
        rows = self._rows(plan, unit)
        if rows is None:
            return tuple(range(len(plan.cells)))
        unusable = _outdated(plan, unit, rows)
        if failed:
            unusable = pl.concat([unusable, rows.filter(pl.col(STATUS) == FAILED)])
        there = set(_cells(plan, unit, rows)) - set(_cells(plan, unit, unusable))
        return tuple(cell for cell in range(len(plan.cells)) if cell not in there)

    def _set_apart(self, plan: Plan, unit: Unit) -> None:
        """Move the rows of changed files to a folder named by the hash of the former files.

        They are written there before the part is written without them.
        """
        rows = self._rows(plan, unit)
        if rows is None or not (outdated := _outdated(plan, unit, rows)).height:
            return
        for (files_hash,), some in outdated.group_by(FILES):
            with writing(self.folder / FORMER / str(files_hash) / self._part(unit).name) as path:
                path.write_bytes(part_of(some))
        gone = set(_cells(plan, unit, outdated))
        kept = rows.filter([cell not in gone for cell in _cells(plan, unit, rows)])
        if kept.height:
            with writing(self._part(unit)) as path:
                path.write_bytes(part_of(kept))
        else:
            self._part(unit).unlink()

    def _flown(self) -> list[Unit]:
        there = [unit for unit in units_of(self.design()) if self._part(unit).is_file()]
        if not there:
            raise PaveTwinError(f"Nothing of the study in '{self.folder}' is flown yet; use `pavetwin experiment run`.")
        return there

    def _part(self, unit: Unit) -> Path:
        return self.folder / PARTS / f"{unit.name}.parquet"

    def _holds_anything(self) -> bool:
        if not self.folder.exists():
            return False
        if not self.folder.is_dir():
            raise PaveTwinError(f"'{self.folder}' is a file; choose another name.")
        if not any(not path.name.startswith(".") for path in self.folder.iterdir()):
            return False
        if not (self.folder / DESIGN).is_file():
            raise PaveTwinError(f"'{self.folder}' exists and holds no study; choose another folder.")
        return True


def query(folder: Path, sql: str) -> pl.DataFrame:
    """Run an SQL query (DuckDB) over the table `segments` of a study, and `former` if it exists.

    Raises:
        PaveTwinError: the folder holds no study, or the query fails.
    """
    import duckdb

    store = Store(folder)
    table, former = store.table().to_arrow(), store.former()
    with duckdb.connect() as connection:
        connection.register("segments", table)
        if former is not None:
            connection.register("former", former.to_arrow())
        connection.execute("set enable_external_access = false")
        try:
            kinds = {statement.type.name for statement in connection.extract_statements(sql)}
            if not kinds or kinds - {"SELECT", "EXPLAIN", "MULTI"}:
                raise PaveTwinError("This is not a query: begin with SELECT or FROM segments.")
            found: pl.DataFrame = connection.sql(sql).pl()
        except duckdb.Error as error:
            raise PaveTwinError(f"The query failed: {' '.join(str(error).split())}") from error
    return found


def _cells(plan: Plan, unit: Unit, rows: pl.DataFrame) -> list[int]:
    """The place of each row's cell in the plan."""
    places = {tuple(plan.levels(unit, cell).values()): at for at, cell in enumerate(plan.cells)}
    return [places[row] for row in rows.select(*FACTORS, *plan.design.sweep_columns).rows()]


def _outdated(plan: Plan, unit: Unit, rows: pl.DataFrame) -> pl.DataFrame:
    """The rows flown with files that have changed since."""
    if not plan.files:
        return rows.clear()
    if FILES not in rows.columns:
        rows = rows.with_columns(pl.lit(None, pl.String).alias(FILES))
    hashes = [plan.files_hash(unit, plan.cells[cell]) for cell in _cells(plan, unit, rows)]
    return rows.filter(pl.col(FILES).ne_missing(pl.Series(hashes, dtype=pl.String)))


def _description(plan: Plan, models: Mapping[str, Mapping[str, OptionValue]]) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "versions": software_versions(packages=plan.packages),
        "worlds": dict(zip(plan.names, (content[:SHOWN] for content in plan.hashes), strict=True)),
        "files": {path: content[:SHOWN] for path, content in plan.files.items()},
        **({"populations": dict(plan.populations)} if plan.populations else {}),
        **({"models": {sensor: dict(each) for sensor, each in models.items()}} if models else {}),
        **({"owners": {key: list(names) for key, names in plan.owners.items()}} if plan.owners else {}),
        "design": plan.design.model_dump(mode="json"),
    }


def _as_written(value: Any) -> str:
    """A value as YAML on one line."""
    text: str = yaml.safe_dump(value, default_flow_style=True, sort_keys=False, allow_unicode=True, width=math.inf)
    return text.removesuffix("\n...\n").strip()


def _check_same(folder: Path, there: Mapping[str, Any], design: Design) -> None:
    if changes := version_changes(there["versions"]):
        raise PaveTwinError(f"'{folder}' was begun with {listed(changes)}; choose another folder or these versions.")
    begun = Design.parse(there["design"], where=str(folder / DESIGN)).model_dump(mode="json")  # its defaults, too
    for key, value in design.model_dump(mode="json").items():
        if key not in ("replicates", "name", "compare") and (before := begun[key]) != value:
            raise PaveTwinError(
                f"'{folder}' holds another design: its {key} is {_as_written(before)}, not "
                f"{_as_written(value)}; choose another folder."
            )


def _check_owners(folder: Path, there: Owners, plan: Plan) -> None:
    """Raises:
    PaveTwinError: the owners of a swept setting have changed since the study was begun.
    """
    for key in plan.design.sweep:
        before, now = (list(owners[key]) if key in owners else None for owners in (there, plan.owners))
        if before != now:
            words = ["every policy and sensor" if names is None else listed(names) for names in (before, now)]
            raise PaveTwinError(
                f"'{folder}' was begun when {key} belonged to {words[0]}, not to {words[1]}; choose another folder."
            )
