"""`python -m benchmarks.eyes`: assumed recall, fitted sensor and detector compared (docs/explanation/results.md).

    python -m benchmarks.eyes out/eyes/study --plot docs/images/eyes.png

prints the tables of a study by `benchmarks/eyes/study.yaml`;

    python -m benchmarks.eyes --fly out/eyes/missions town:201 berlin.osm
    python -m benchmarks.eyes --missions out/eyes/missions --captures datasets/town-test --plot agreement.png

flies the sensor `detector` over a street of each town in each density, and compares the results of each town with a
sensor fitted to the other towns and to datasets of `pavetwin capture`.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.eyes import agreement, grid, plot, tables
from pavetwin.capture.looks import looks_of
from pavetwin.cli.console import fail, out, progress
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.store import Store
from pavetwin.perception.model_file import DEFAULT, model_path


def main(arguments: Sequence[str] | None = None) -> int:
    """The exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.eyes", description=__doc__.splitlines()[0])
    parser.add_argument("study", nargs="?", type=Path, help="folder of a study by benchmarks/eyes/study.yaml")
    parser.add_argument("--fly", nargs="+", metavar="FOLDER TOWN", help="fly over these towns: KIND:SEED, or a map")
    parser.add_argument("--policies", nargs="+", default=["baseline", "hover", "micro", "skip"], help="to fly")
    parser.add_argument("--densities", nargs="+", default=[*grid.DENSITIES], choices=grid.DENSITIES, help="to fly in")
    parser.add_argument("--altitudes", nargs="+", type=float, default=grid.STUDY["altitudes_m"], help="to fly at")
    parser.add_argument("--model", default=DEFAULT, help="a detector that ships, or a file")
    parser.add_argument("--damage", default="paper", choices=["paper", "survey"], help="to place")
    parser.add_argument("--light", nargs="+", default=[], metavar="NAME=VALUE", help="as time=14:00 clouds=0.7")
    parser.add_argument("--missions", type=Path, help="folder of missions flown by --fly")
    parser.add_argument("--captures", nargs="*", type=Path, default=[], help="further datasets to fit to")
    parser.add_argument("--plot", type=Path, help="file of the figure")
    asked = parser.parse_args(arguments)
    try:
        if asked.fly:
            varied = {
                "policies": asked.policies,
                "altitudes_m": asked.altitudes,
                "defects": {"population": asked.damage},
            }
            light = dict(each.split("=", 1) for each in asked.light)
            under = {f"conditions.{name}": value for name, value in light.items()}
            under["sensing.options.model"] = asked.model
            _fly(Path(asked.fly[0]), asked.fly[1:], asked.densities, varied, under)
        if asked.missions is not None:
            _compare(asked.missions, asked.captures, asked.model, asked.plot)
        if asked.study is not None:
            table = Store(asked.study).table()
            out.print(tables.answers(table), markup=False)
            if asked.plot is not None:
                plot.save_answers(tables.by_sensor(table), asked.plot)
    except PaveTwinError as error:
        fail(str(error))
        return 2
    return 0


def _fly(
    folder: Path, towns: Sequence[str], densities: Sequence[str], varied: Mapping[str, Any], under: Mapping[str, str]
) -> None:
    with progress("Flying", lines=True) as tell:
        for text in towns:
            town = grid.town_of(text)
            world = grid.built(town, folder.with_name("worlds"))
            for density in densities:
                seed = grid.FIRST_SEED + grid.DENSITIES.index(density)
                grid.flown(world, density, seed, folder, varied, under, tell)


def _compare(missions: Path, captures: Sequence[Path], model: str, picture: Path | None) -> None:
    with progress("Searching", lines=True) as tell:
        sets = [looks_of(each, model_path(model), 0.25, lambda share: tell(share, "Searching")) for each in captures]
    flown, models = agreement.predicted(missions, sets)
    cells = agreement.cells(flown)
    out.print(agreement.markdown(cells), markup=False)
    for by in (agreement.CELL, ("traffic", "altitude_m"), ("altitude_m",)):
        out.print(f"By {', '.join(by)}: {agreement.summary(agreement.cells(flown, by))}", markup=False)
    for town, fitted in models.items():
        out.print(f"Without {town}: {fitted.fitted_to.looks} looks, correlation {fitted.correlation:.2f}", markup=False)
    if picture is not None:
        plot.save_agreement(cells, picture)


if __name__ == "__main__":
    sys.exit(main())
