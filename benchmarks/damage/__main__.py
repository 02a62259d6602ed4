"""`python -m benchmarks.damage`: what a damage population places, beside what its sources found.

    python -m benchmarks.damage --rdd ../shared/data/real/rdd2022_china_drone/China_Drone/train \\
        --pdd ../shared/data/real/uav_pdd2023_samples --plot docs/images/damage.png

builds several towns and prints the table of docs/explanation/defects.md. Without the folders of photographs (RDD2022's
China drone subset, samples of UAV-PDD2023) their boxes are left out.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from benchmarks.damage.placed import placed
from benchmarks.damage.plot import save_plot
from benchmarks.damage.sources import rdd2022, uav_pdd2023
from benchmarks.damage.table import table
from pavetwin.cli.console import fail, out, progress
from pavetwin.defects import DefectOptions, place
from pavetwin.errors import PaveTwinError
from pavetwin.mission.inputs import OnProgress
from pavetwin.world.build import BuildOptions, build_world
from pavetwin.world.model import Defect, Segment

TOWNS: Final = 24
"""A few worn streets decide the mean density: that of six towns varies by a quarter."""


def towns(
    sources: Sequence[str], number: int, population: str, tell: OnProgress
) -> Iterator[tuple[str, Sequence[Segment], Sequence[Defect]]]:
    """Generated towns and those of maps, with their defects.

    Raises:
        PaveTwinError: there is no such map or population.
    """
    named = [("town", seed) for seed in range(1, number + 1)] + [(source, 1) for source in sources]
    for at, (source, seed) in enumerate(named):
        tell(at / len(named))
        segments = build_world(source, BuildOptions(seed=seed)).world.segments
        yield f"{Path(source).stem} {seed}", segments, place(segments, seed, DefectOptions(population=population))


def main(arguments: Sequence[str] | None = None) -> int:
    """The exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.damage", description=__doc__.splitlines()[0])
    parser.add_argument("--rdd", type=Path, metavar="FOLDER", help="RDD2022's China drone subset: its train/")
    parser.add_argument("--pdd", type=Path, metavar="FOLDER", help="samples of UAV-PDD2023")
    parser.add_argument("--maps", nargs="*", default=[], metavar="MAP.osm", help="towns of maps, beside generated ones")
    parser.add_argument("--towns", type=int, default=TOWNS, help="how many towns to generate")
    parser.add_argument("--population", default="survey", help="damage population: a name or a file")
    parser.add_argument("--plot", type=Path, help="draw the distributions into this file")
    asked = parser.parse_args(arguments)
    try:
        seen = [read(folder) for read, folder in ((rdd2022, asked.rdd), (uav_pdd2023, asked.pdd)) if folder]
        with progress("Building towns") as tell:
            found = placed(list(towns(asked.maps, asked.towns, asked.population, tell)))
        if asked.plot is not None:
            save_plot(found, seen, asked.plot)
    except PaveTwinError as error:
        fail(str(error))
        return 2
    out.line(table(found, seen))
    return 0


if __name__ == "__main__":
    sys.exit(main())
