"""`python -m benchmarks.effects demo MAP.osm … -o FOLDER`: the size of each effect, as docs/limits.md has it.

    python -m benchmarks.effects demo ../shared/data/osm/berlin_neukoelln.osm \\
        ../shared/data/osm/seattle_roosevelt.osm:north_america -o out/effects --plot docs/images/effects.png

`demo` is the demo's town. A map may name the rule of parking places behind a colon; a folder is a world that was built.
Each change is a study in FOLDER/studies; the same command continues an interrupted run. It writes `effects.md`,
`effects.csv` and `effects.png` into FOLDER.
"""

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import polars as pl

from benchmarks.effects import table as tables
from benchmarks.effects.catalogue import BEFORE, CRACKS, DEFAULT, VARIANTS, Variant, design_of
from benchmarks.effects.cracks import cracks_table, reach_table
from benchmarks.effects.plot import save_plot
from benchmarks.effects.sizes import as_table, effects
from benchmarks.effects.tour import SEGMENTS, tours
from pavetwin.cli.console import err, fail, out, progress
from pavetwin.cli.demo import TOWN_SEED
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.engines import Engine, Pool, Single
from pavetwin.experiments.run import run
from pavetwin.experiments.statistics import MissionLimits
from pavetwin.mission.inputs import OnProgress
from pavetwin.world.build import BuildOptions, build_world
from pavetwin.world.store import save_world

TRAFFIC: Final = "los-C"
REPLICATES: Final = 12
TOURS: Final = 0
"""Replicates of the missions over `SEGMENTS` segments."""


def world_of(text: str, folder: Path) -> Path:
    """The folder of a world: one that is there, the demo's town, or a map's, built once.

    Raises:
        PaveTwinError: there is no such file, or no world can be built of it.
    """
    if text != "demo" and Path(text).is_dir():
        return Path(text)
    source, _, rule = text.partition(":")
    target = folder / Path(source).stem
    if not (target / "world.yaml").is_file():
        options = {"seed": TOWN_SEED} if text == "demo" else {"parking_rule": rule or "europe"}
        built = build_world("town" if text == "demo" else source, BuildOptions.parse(options, where=text))
        save_world(built, target, force=True)
    return target


def fly(
    variants: Sequence[Variant], worlds: Sequence[Path], folder: Path, engine: Engine, asked: argparse.Namespace,
    tell: OnProgress,
) -> dict[str, pl.DataFrame]:  # fmt: skip
    """The table of each variant's study, and of the two tours as `tour-before` and `tour-default`."""
    studies: list[tuple[str, Variant, dict[str, Any], int]] = [
        (variant.name, variant, {}, asked.replicates) for variant in variants
    ]
    if BEFORE in variants and asked.tours:
        changes = {"segments": asked.segments, "order": "near"}
        studies += [(f"tour-{each.name}", each, changes, asked.tours) for each in (BEFORE, DEFAULT)]
    flown = {}
    for at, (name, variant, changes, replicates) in enumerate(studies):

        def of_all(share: float, what: str = "", at: int = at, name: str = name) -> None:
            tell((at + share) / len(studies), f"{name}: {what}")

        design = design_of(variant, worlds, asked.traffic, replicates, **changes)
        ran = run(design, folder / "studies" / name, engine, on_progress=of_all, on_notice=err.line)
        for reason, count in ran.failures.items():
            err.line(f"{name}: {count} missions failed: {reason}")
        flown[name] = ran.table
    return flown


def chosen(names: Sequence[str]) -> list[Variant]:
    """All variants, or the named ones with what they are compared with.

    Raises:
        PaveTwinError: there is none of a name.
    """
    known = {variant.name: variant for variant in VARIANTS}
    if unknown := [name for name in names if name not in known]:
        raise PaveTwinError(f"`only`: no effect '{unknown[0]}'; known: {', '.join(known)}.")
    wanted = {DEFAULT.name, *names, *(known[name].against for name in names)}
    return [variant for variant in VARIANTS if not names or variant.name in wanted]


def measure(asked: argparse.Namespace, tell: OnProgress) -> str:
    """Fly what is missing, write everything, and give the Markdown."""
    folder: Path = asked.output
    limits = MissionLimits(max_time_s=asked.max_time)
    variants = chosen(asked.only)
    tell(0.0, "Building worlds")
    worlds = [world_of(text, folder / "worlds") for text in asked.worlds]
    engine = Single() if asked.jobs == 1 else Pool(asked.jobs)
    flown = fly(variants, worlds, folder, engine, asked, tell)
    tell(1.0, "Comparing")
    found = [
        effect
        for variant in variants
        if variant != DEFAULT
        for effect in effects(variant, flown[variant.against], flown[variant.name], limits)
    ]
    parts = [tables.default_line(flown[DEFAULT.name], limits)]
    for kind in dict.fromkeys(effect.variant.kind for effect in found):
        parts += [f"## {tables.SECTIONS[kind]}", tables.effects_table(found, kind)]
    parts += ["## Proposals", tables.proposals_table(flown[DEFAULT.name], found, limits)]
    parts += ["## Choices", tables.choices_table(flown[DEFAULT.name])]
    if cracks := [variant for variant in variants if variant.defects == CRACKS]:
        parts += ["## Cracks", cracks_table(flown, cracks, limits), reach_table(flown, cracks)]
    if BEFORE in variants:
        told = tours(flown[BEFORE.name], flown[DEFAULT.name], limits)
        parts += ["## Before and after", tables.tours_table(told, 1)]
    if f"tour-{BEFORE.name}" in flown:
        was, now = flown[f"tour-{BEFORE.name}"], flown[f"tour-{DEFAULT.name}"]
        parts += ["## Whole inspections before and after", tables.tours_table(tours(was, now, limits), asked.segments)]
    text = "\n\n".join(parts) + "\n"
    (folder / "effects.md").write_text(text, encoding="utf-8")
    as_table(found).write_csv(folder / "effects.csv")
    save_plot(found, folder / "effects.png" if asked.plot is None else asked.plot)
    return text


def main(arguments: Sequence[str] | None = None) -> int:
    """The exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.effects", description=__doc__.splitlines()[0])
    parser.add_argument("worlds", nargs="+", metavar="WORLD", help="demo, a map (MAP.osm or MAP.osm:RULE), or a folder")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/effects"), help="folder of studies and results")
    parser.add_argument("--replicates", type=int, default=REPLICATES, help="of one segment each, in each world")
    parser.add_argument(
        "--tours",
        type=int,
        default=TOURS,
        help="replicates of missions over several segments, before and after; 0 for none",
    )
    parser.add_argument("--segments", type=int, default=SEGMENTS, help="that each of these inspects")
    parser.add_argument("--traffic", default=TRAFFIC, help="the usual traffic")
    parser.add_argument("--max-time", type=float, help="limit of time of the proposals, in seconds a mission")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="worker processes")
    parser.add_argument("--only", nargs="*", default=[], metavar="EFFECT", help="fly these effects alone")
    parser.add_argument("--plot", type=Path, help="the plot's file, instead of effects.png in the folder")
    asked = parser.parse_args(arguments)
    try:
        with progress("Flying") as tell:
            text = measure(asked, tell)
    except PaveTwinError as error:
        fail(str(error))
        return 2
    out.line(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
