"""A study's folder: `design.yaml`, and its table `segments.parquet` in parts, one for each unit that was flown."""

from collections.abc import Iterable, Mapping
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import polars as pl
import yaml

from pavetwin.errors import PaveTwinError
from pavetwin.experiments.design import Design
from pavetwin.experiments.metrics import FAILED, STATUS
from pavetwin.experiments.plan import Plan, Unit, units_of
from pavetwin.files import writing

DESIGN, PARTS, FORMAT = "design.yaml", "segments.parquet", 1

SHOWN: Final = 12
"""Characters of a hash in `design.yaml`."""


class Store:
    """One study on disk."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def begin(self, plan: Plan) -> None:
        """Make the folder ready for a design: a new one, or one that was begun with the same.

        More replicates than before may be asked for; they are added.

        Raises:
            PaveTwinError: the folder holds something else; the message names the first difference.
        """
        wanted = _description(plan)
        if self._holds_anything():
            there = self.description()
            _check_same(self.folder, there, wanted)
            if there["design"]["replicates"] > plan.design.replicates:
                raise PaveTwinError(
                    f"'{self.folder}' was begun with {there['design']['replicates']} replicates, more than "
                    f"{plan.design.replicates}; choose another folder."
                )
        with writing(self.folder / DESIGN) as path:
            path.write_text(yaml.safe_dump(wanted, sort_keys=False, allow_unicode=True), encoding="utf-8")

    def description(self) -> dict[str, Any]:
        """What `design.yaml` holds.

        Raises:
            PaveTwinError: there is no study in the folder, or the file is damaged.
        """
        path = self.folder / DESIGN
        if not path.is_file():
            raise PaveTwinError(
                f"'{self.folder}' holds no study; make one with `pavetwin experiment run DESIGN.yaml -o {self.folder}`."
            )
        try:
            found = yaml.safe_load(path.read_text(encoding="utf-8"))
            Design.parse(found["design"], where=str(path))
            found["format"], found["pavetwin"], found["worlds"]
        except (yaml.YAMLError, OSError, UnicodeDecodeError, KeyError, TypeError) as error:
            raise PaveTwinError(f"'{path}' is damaged; run the study into another folder.") from error
        return dict(found)

    def design(self) -> Design:
        """The design that the study was begun with."""
        return Design.parse(self.description()["design"], where=str(self.folder / DESIGN))

    def missing(self, units: Iterable[Unit]) -> list[Unit]:
        """Those that have no part yet, or a damaged one."""
        return [unit for unit in units if not _is_whole(self._part(unit))]

    def write(self, unit: Unit, part: bytes) -> None:
        """Put a unit's part into the table."""
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
                raise PaveTwinError(f"'{part}' is damaged; run the study again, which flies it anew.") from error
            if table.select("replicate", "traffic").unique().rows() != [(unit.replicate, unit.traffic)]:
                raise PaveTwinError(f"'{part}' holds another part of a study; remove it and run the study again.")
            tables.append(table)
        return pl.concat(tables)

    def forget_failed(self) -> None:
        """Remove the parts in which a mission failed, so that they are flown again."""
        for part in (self.folder / PARTS).glob("*.parquet"):
            if _is_whole(part) and (pl.read_parquet(part, columns=[STATUS])[STATUS] == FAILED).any():
                part.unlink()

    def _flown(self) -> list[Unit]:
        there = [unit for unit in units_of(self.design()) if self._part(unit).is_file()]
        if not there:
            raise PaveTwinError(
                f"Nothing of the study in '{self.folder}' was flown yet; `pavetwin experiment run` goes on."
            )
        return there

    def _part(self, unit: Unit) -> Path:
        return self.folder / PARTS / f"{unit.name}.parquet"

    def _holds_anything(self) -> bool:
        if not self.folder.exists():
            return False
        if not self.folder.is_dir():
            raise PaveTwinError(f"--output: '{self.folder}' is a file; choose another name.")
        if not any(not path.name.startswith(".") for path in self.folder.iterdir()):
            return False
        if not (self.folder / DESIGN).is_file():
            raise PaveTwinError(f"--output: '{self.folder}' exists and holds no study; choose another folder.")
        return True


def query(folder: Path, sql: str) -> pl.DataFrame:
    """The answer to a question in SQL (DuckDB's) over the table `segments` of a study.

    Raises:
        PaveTwinError: there is no study, or the question cannot be answered.
    """
    import duckdb

    table = Store(folder).table().to_arrow()
    with duckdb.connect() as connection:
        connection.register("segments", table)
        connection.execute("set enable_external_access = false")
        try:
            kinds = {statement.type.name for statement in connection.extract_statements(sql)}
            if not kinds or kinds - {"SELECT", "EXPLAIN", "MULTI"}:
                raise PaveTwinError("That is no question: begin with SELECT or FROM segments.")
            found: pl.DataFrame = connection.sql(sql).pl()
        except duckdb.Error as error:
            raise PaveTwinError(f"The question could not be answered: {' '.join(str(error).split())}") from error
    return found


def _is_whole(part: Path) -> bool:
    """Whether a Parquet file is there and can be read to its end: a footer may outlive what it speaks of."""
    try:
        pl.read_parquet(part)
    except (OSError, pl.exceptions.PolarsError):
        return False
    return True


def _description(plan: Plan) -> dict[str, Any]:
    design = plan.design
    scripts = [policy.rpartition(":")[0] for policy in design.policies if ":" in policy]
    routes = [route for world in design.worlds for route in world.routes]
    return {
        "format": FORMAT,
        "pavetwin": version("pavetwin"),
        "sumo": version("libsumo"),
        "worlds": dict(zip(plan.names, (content[:SHOWN] for content in plan.hashes), strict=True)),
        "files": {path: sha256(Path(path).read_bytes()).hexdigest()[:SHOWN] for path in (*scripts, *routes)},
        "design": design.model_dump(mode="json"),
    }


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
                f"'{folder}' holds another design: its {key} is {before}, not {value}; choose another folder."
            )
    for key, what in (("worlds", "another world"), ("files", "another file")):
        if there.get(key) != wanted[key]:
            changed = [name for name, content in wanted[key].items() if there.get(key, {}).get(name) != content]
            raise PaveTwinError(
                f"'{folder}' was begun with {what} than '{', '.join(changed)}' is now; choose another folder."
            )
