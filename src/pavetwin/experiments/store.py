"""A study's folder: `design.yaml`, and its table `segments.parquet` in parts, one for each unit that was flown."""

import math
from collections.abc import Iterable, Mapping
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from shlex import quote
from typing import Any, Final

import polars as pl
import yaml

from pavetwin.errors import PaveTwinError
from pavetwin.experiments.design import Design
from pavetwin.experiments.metrics import FAILED, STATUS
from pavetwin.experiments.plan import Plan, Unit, units_of
from pavetwin.files import writing
from pavetwin.plugins import files_of

DESIGN, PARTS, FORMAT = "design.yaml", "segments.parquet", 2

SHOWN: Final = 12
"""Characters of a hash in `design.yaml`."""


class Store:
    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def check_design(self, design: Design) -> None:
        """Whether the folder is a new one, or was begun with the same design and versions; nothing is written.

        More replicates than before may be asked for.

        Raises:
            PaveTwinError: the folder holds something else; the message names the first difference.
        """
        if self._holds_anything():
            there = self.description()
            _check_same(self.folder, there, _heading(design))
            if there["design"]["replicates"] > design.replicates:
                raise PaveTwinError(
                    f"'{self.folder}' was begun with {there['design']['replicates']} replicates, more than "
                    f"{design.replicates}; choose another folder."
                )

    def check(self, plan: Plan, *, retry: bool = False) -> None:
        """As `check_design`, and whether it was begun over the same worlds and with the same files.

        Args:
            retry: a policy's file, or one that it imports, may be another where every mission of the policy failed; a
                routes file where every mission over its world did.

        Raises:
            PaveTwinError: it holds something else; the message names the first difference.
        """
        self.check_design(plan.design)
        if not self._holds_anything():
            return
        there, wanted = self.description(), _description(plan)
        for key, what in (("worlds", "another world"), ("files", "another file")):
            before = there.get(key, {})
            for name in (name for name, content in wanted[key].items() if before.get(name) != content):
                refused = f"'{self.folder}' was begun with {what} than '{name}' is now"
                if key == "worlds":
                    raise PaveTwinError(f"{refused}; choose another folder.")
                self._check_replaced(_flown_with(plan, name), refused, retry=retry)

    def _check_replaced(self, concerned: pl.Expr, refused: str, *, retry: bool) -> None:
        """Whether a file may be replaced: no mission flown with it succeeded."""
        flown = [
            pl.read_parquet(self._part(unit), columns=["world", "policy", "sensor", STATUS]) for unit in self._flown()
        ]
        missions = pl.concat(flown).filter(concerned)
        failed = missions.filter(pl.col(STATUS) == FAILED).height
        if failed < missions.height or not missions.height:
            raise PaveTwinError(
                f"{refused}; choose another folder. It may be another only where every mission flown with it failed: "
                f"{failed} of {missions.height} did."
            )
        if not retry:
            raise PaveTwinError(f"{refused}. As every mission flown with it failed, `retry` flies them again.")

    def begin(self, plan: Plan, *, retry: bool = False) -> None:
        """Make the folder ready for a design that was checked.

        Args:
            retry: forget what failed.
        """
        with writing(self.folder / DESIGN) as path:
            path.write_text(yaml.safe_dump(_description(plan), sort_keys=False, allow_unicode=True), encoding="utf-8")
        if retry:
            self.forget_failed()

    def description(self) -> dict[str, Any]:
        """What `design.yaml` holds.

        Raises:
            PaveTwinError: there is no study in the folder, or the file is damaged.
        """
        path = self.folder / DESIGN
        if not path.is_file():
            raise PaveTwinError(
                f"'{self.folder}' holds no study; make one with "
                f"`pavetwin experiment run DESIGN.yaml output={quote(str(self.folder))}`."
            )
        try:
            found = yaml.safe_load(path.read_text(encoding="utf-8"))
            Design.parse(found["design"], where=str(path))
            found["format"], found["pavetwin"], found["worlds"]
        except (yaml.YAMLError, OSError, UnicodeDecodeError, KeyError, TypeError) as error:
            raise PaveTwinError(f"'{path}' is damaged; run the study into another folder.") from error
        return dict(found)

    def design(self) -> Design:
        return Design.parse(self.description()["design"], where=str(self.folder / DESIGN))

    def missing(self, units: Iterable[Unit], *, failed: bool = False) -> list[Unit]:
        """Those that have no part yet, or a damaged one; with `failed` also those of which a mission failed."""
        parts = {unit: self._part(unit) for unit in units}
        return [unit for unit, part in parts.items() if not _is_whole(part) or (failed and _has_failed(part))]

    def write(self, unit: Unit, part: bytes) -> None:
        with writing(self._part(unit)) as path:
            path.write_bytes(part)

    def parts(self) -> list[Path]:
        """The table's files, in the order of the design.

        Raises:
            PaveTwinError: there is no study in the folder, or nothing of it was flown yet.
        """
        return [self._part(unit) for unit in self._flown()]

    def table(self) -> pl.DataFrame:
        """The whole table, as far as it was flown.

        Raises:
            PaveTwinError: nothing was flown yet, or a part is damaged.
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
        return pl.concat(tables)

    def forget_failed(self) -> None:
        """Remove the parts in which a mission failed, so that they are flown again."""
        for part in (self.folder / PARTS).glob("*.parquet"):
            if _is_whole(part) and _has_failed(part):
                part.unlink()

    def _flown(self) -> list[Unit]:
        there = [unit for unit in units_of(self.design()) if self._part(unit).is_file()]
        if not there:
            raise PaveTwinError(
                f"Nothing of the study in '{self.folder}' was flown yet; use `pavetwin experiment run`."
            )
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
    """The result of an SQL query (DuckDB's) of the table `segments` of a study.

    Raises:
        PaveTwinError: there is no study, or the query fails.
    """
    import duckdb

    table = Store(folder).table().to_arrow()
    with duckdb.connect() as connection:
        connection.register("segments", table)
        connection.execute("set enable_external_access = false")
        try:
            kinds = {statement.type.name for statement in connection.extract_statements(sql)}
            if not kinds or kinds - {"SELECT", "EXPLAIN", "MULTI"}:
                raise PaveTwinError("This is not a query: begin with SELECT or FROM segments.")
            found: pl.DataFrame = connection.sql(sql).pl()
        except duckdb.Error as error:
            raise PaveTwinError(f"The query failed: {' '.join(str(error).split())}") from error
    return found


def _is_whole(part: Path) -> bool:
    """Whether a Parquet file is there and can be read to its end: its footer may be intact where its data are not."""
    try:
        pl.read_parquet(part)
    except (OSError, pl.exceptions.PolarsError):
        return False
    return True


def _has_failed(part: Path) -> bool:
    return bool((pl.read_parquet(part, columns=[STATUS])[STATUS] == FAILED).any())


def _heading(design: Design) -> dict[str, Any]:
    """What a study's description says before its worlds were read."""
    return {
        "format": FORMAT,
        "pavetwin": version("pavetwin"),
        "sumo": version("libsumo"),
        "design": design.model_dump(mode="json"),
    }


def _description(plan: Plan) -> dict[str, Any]:
    design = plan.design
    scripts = [script for name in (*design.policies, *design.sensors) for script in _scripts(name)]
    routes = [route for world in design.worlds for route in world.routes]
    models = {cell.settings(design).camera.model.partition(":")[0] for cell in plan.cells}
    cameras = sorted(model for model in models if model.endswith((".yaml", ".yml")))
    heading = _heading(design)
    return {
        **{key: heading[key] for key in ("format", "pavetwin", "sumo")},
        "worlds": dict(zip(plan.names, (content[:SHOWN] for content in plan.hashes), strict=True)),
        "files": {path: sha256(Path(path).read_bytes()).hexdigest()[:SHOWN] for path in (*scripts, *routes, *cameras)}
        | {path: content[:SHOWN] for path, content in plan.plugins.items()},
        "design": heading["design"],
    }


def _scripts(name: str) -> list[str]:
    """The files that a policy or sensor of the user's own is made of, and its data; it has been loaded."""
    path, colon, _ = name.rpartition(":")
    return [str(file) for file in files_of(path)] if colon else []


def _flown_with(plan: Plan, file: str) -> pl.Expr:
    """The rows of the table that were flown with a file."""
    if file in plan.plugins or file.endswith((".yaml", ".yml")):
        return pl.lit(value=True)
    policies = [called for policy, called in plan.policies.items() if file in _scripts(policy)]
    worlds = [name for name, entry in zip(plan.names, plan.design.worlds, strict=True) if file in entry.routes]
    sensors = [sensor for sensor in plan.design.sensors if file in _scripts(sensor)]
    return pl.col("policy").is_in(policies) | pl.col("sensor").is_in(sensors) | pl.col("world").is_in(worlds)


def _as_written(value: Any) -> str:
    """A value as a design may hold it, on one line."""
    text: str = yaml.safe_dump(value, default_flow_style=True, sort_keys=False, allow_unicode=True, width=math.inf)
    return text.removesuffix("\n...\n").strip()


def _check_same(folder: Path, there: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    for key, what in (("format", "format"), ("pavetwin", "PaveTwin's version"), ("sumo", "SUMO's version")):
        if there.get(key) != wanted[key]:
            raise PaveTwinError(
                f"'{folder}' was begun with {what} {there.get(key)}, not {wanted[key]}; choose another folder."
            )
    for key, value in wanted["design"].items():
        before = there["design"].get(key)
        if key not in ("replicates", "name") and before != value:
            raise PaveTwinError(
                f"'{folder}' holds another design: its {key} is {_as_written(before)}, not "
                f"{_as_written(value)}; choose another folder."
            )
