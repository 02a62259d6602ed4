"""`pavetwin experiment …`: factorial studies, from a design to a report."""

import os
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from pavetwin.cli.commands import Commands
from pavetwin.cli.console import err, note_fonts, out, progress
from pavetwin.cli.options import CacheFolder, Plugins, grouped, paths_of
from pavetwin.cli.published import note_difference
from pavetwin.errors import PaveTwinError, naming

if TYPE_CHECKING:
    from rich.table import Table

    from pavetwin.experiments.design import Design
    from pavetwin.experiments.engine import Engine
    from pavetwin.experiments.run import Ran
    from pavetwin.experiments.statistics import MissionLimits, Objective, Recommendation
    from pavetwin.experiments.store import Store

app = Commands(
    help="Fly studies: policies, altitudes and traffic in replicates, with statistics.",
    no_args_is_help=True,
)

Folder = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a study.")]

FAILED_CODE = 1
MOST_REASONS, MOST_COLUMNS = 5, 14


@dataclass(frozen=True)
class LimitOptions:
    """Recommendation."""

    max_time_s: Annotated[
        float | None,
        typer.Option(
            "--max-time",
            metavar="S",
            min=0.001,
            help="Longest mean time of a segment, in seconds; in a study of tours, of a mission.",
        ),
    ] = None
    max_energy: Annotated[
        float | None, typer.Option(metavar="%", min=0.001, help="Largest mean energy of the same, in % of a battery.")
    ] = None
    min_coverage: Annotated[
        float | None, typer.Option(metavar="%", min=0, max=100, help="Smallest mean coverage, in %.")
    ] = None
    objective: Annotated[
        str,
        typer.Option(
            "--choose",
            help="Among the options within the limits, the one with the best coverage (most-found), the highest "
            "altitude (highest), the shortest time (fastest), the least energy (least-energy) or, by its detections, "
            "the smallest error of the condition index (most-accurate-index). All except most-found need "
            "--min-coverage.",
        ),
    ] = "most-found"

    def limits(self) -> "MissionLimits":
        """The limits, with shares instead of percentages."""
        from pavetwin.experiments.statistics import MissionLimits

        energy, coverage = (
            None if percent is None else percent / 100 for percent in (self.max_energy, self.min_coverage)
        )
        return MissionLimits(max_time_s=self.max_time_s, max_energy=energy, min_coverage=coverage)

    def chosen_objective(self) -> "Objective":
        """Raises:
        PaveTwinError: there is no such objective.
        """
        from pavetwin.experiments.statistics import Objective

        return Objective.named(self.objective)


@app.command()
def init(
    target: Annotated[Path, typer.Argument(metavar="DESIGN.yaml", help="File to write.")],
    world: Annotated[str, typer.Option(help="Folder of the world, relative to the file.")] = "worlds/town",
    preset: Annotated[
        str,
        typer.Option(help="default: a first study, flown as by `pavetwin fly`; paper: the published one."),
    ] = "default",
    force: Annotated[bool, typer.Option("--force", help="Replace the file.")] = False,
    plugins: Plugins = None,
) -> None:
    """Write a commented design to start from.

    \b
    pavetwin experiment init study.yaml --world worlds/my-town
    pavetwin world build --generate town --seed 1 --parking-rule none --damage paper -o worlds/published
    pavetwin experiment init paper.yaml --preset paper --world worlds/published
    pavetwin experiment init mine.yaml --world worlds/rutted --plugin my_policy.py
    """
    from pavetwin.experiments.design import preset_text
    from pavetwin.files import writing
    from pavetwin.plugins import load_plugins, registered_in
    from pavetwin.policies import POLICIES

    load_plugins(plugins or ())
    own = [name for path in plugins or () for what, name in registered_in(path) if what == POLICIES.what]
    folder = target.absolute().parent
    beside = [os.path.relpath(path, folder) for path in paths_of(plugins)]
    text, place = preset_text(preset, world, beside, own), folder / world
    if target.exists() and not force:
        raise PaveTwinError(f"'{target}' exists; choose another name or add `force`.")
    with writing(target) as path:
        path.write_text(text, encoding="utf-8")
    if not place.is_dir():
        out.print(
            f"[yellow]Note:[/] there is no world in {place} yet; the path is relative to the design.", soft_wrap=True
        )
    note_difference([preset], [place], preset)  # the design names the population
    out.line(
        f"Wrote {target} with the preset {preset}. Next: pavetwin experiment run {quote(str(target))} "
        f"-o {quote(str(target.with_suffix('')))}"
    )


@app.command()
def run(
    design: Annotated[Path, typer.Argument(metavar="DESIGN.yaml", help="The design; `init` writes one.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder of the study; an unfinished one is continued.")
    ],
    jobs: Annotated[int | None, typer.Option(min=1, help="Number of worker processes; default: one per core.")] = None,
    engine: Annotated[str, typer.Option(help="Distribution of the missions: local or dask.")] = "local",
    scheduler: Annotated[
        str | None, typer.Option(metavar="tcp://HOST:PORT", help="With dask: address of a running scheduler.")
    ] = None,
    plugins: Plugins = None,
    cache: CacheFolder = None,  # noqa: ARG001 - its callback does it
    retry: Annotated[bool, typer.Option("--retry-failed", help="Fly failed missions again.")] = False,
) -> None:
    """Fly a study. After an interruption the same command continues; after an edit of your own policy it flies the
    missions of that policy again.

    \b
    pavetwin experiment run study.yaml -o studies/first
    pavetwin experiment run study.yaml -o studies/first --engine dask --jobs 8
    pavetwin experiment run study.yaml -o studies/first --engine dask --scheduler tcp://10.0.0.1:8786
    """
    from pavetwin.capture.mission_images import MissionImages
    from pavetwin.experiments.design import read_design
    from pavetwin.experiments.run import run as run_study
    from pavetwin.plugins import load_plugins

    chosen = read_design(design)
    if plugins:
        load_plugins(paths_of(plugins))
        chosen = chosen.model_copy(update={"plugins": (*chosen.plugins, *paths_of(plugins))})
    works = _engine(engine, scheduler, jobs, chosen)
    of = None if isinstance(chosen.defects, str) else chosen.defects.population
    note_difference(chosen.presets, (Path(entry.path) for entry in chosen.worlds), of)
    with naming({"the design:": f"the design '{design}':"}), progress("Reading worlds", lines=True) as show:
        ran = run_study(
            chosen,
            output,
            works,
            image_source_factory=MissionImages,
            retry=retry,
            on_progress=show,
            on_notice=err.line,
        )
    _print_run(ran, output)
    if ran.failures:
        raise typer.Exit(FAILED_CODE)


@app.command()
def query(
    folder: Folder,
    sql: Annotated[str, typer.Argument(metavar="SQL", help="A query of the table `segments`, in DuckDB's SQL.")],
    csv: Annotated[bool, typer.Option("--csv", help="Print everything as CSV instead of a table.")] = False,
) -> None:
    """Query the table of a study with SQL. One row is one segment mission: the part of a mission over one segment.

    \b
    pavetwin experiment query studies/first "select policy, avg(coverage) from segments group by all order by 1"
    pavetwin experiment query studies/first "from segments where status = 'failed'" --csv > failed.csv
    """
    import polars as pl

    from pavetwin.experiments.store import query as ask

    answer = ask(folder, sql)
    if csv:
        out.rich.file.write(answer.write_csv())
        return
    if answer.width > MOST_COLUMNS:
        out.print(f"{answer.width} columns, of which the first and last are shown; select some by name, or add --csv.")
    with pl.Config(
        tbl_rows=60,
        tbl_cols=MOST_COLUMNS,
        tbl_width_chars=out.rich.width,
        fmt_str_lengths=40,
        tbl_hide_dataframe_shape=True,
    ):
        out.print(str(answer), markup=False)
    out.print(f"{answer.height} rows", markup=False)


@app.command()
@grouped
def report(
    folder: Folder,
    chosen: LimitOptions,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the files; default: that of the study.")
    ] = None,
    figures: Annotated[bool, typer.Option("--figures", help="Also write every figure as a file, SVG or PNG.")] = False,
) -> None:
    """Write report.html, which opens offline, and the table as CSV, Markdown and LaTeX.

    The first page holds the recommendation, within any limits given.

    \b
    pavetwin experiment report studies/first
    pavetwin experiment report studies/first --max-time 120
    pavetwin experiment report studies/first --choose highest --min-coverage 25
    pavetwin experiment report studies/first --figures
    """
    from pavetwin.experiments.report.page import write_report
    from pavetwin.experiments.report.study import gather_folder
    from pavetwin.experiments.store import Store

    limits, objective = chosen.limits(), chosen.chosen_objective()
    store = Store(folder)
    with progress("Statistics", lines=True) as show:
        study = gather_folder(store, limits=limits, objective=objective)
        place = output or folder
        written = write_report(study, place, lambda share: show(share, "Drawing the report"), figures=figures)
    _note_unfinished(store)
    note_fonts(*study.worlds.values())
    for each in study.advice:
        out.line(" ".join([each.assumption, *each.sentences]).strip())
    names = [str(path) for path in written if path.parent == place]
    drawn = [f"{len(written) - len(names)} files in {place}/figures/"] if figures else []
    out.line(f"\nWritten: {', '.join(names + drawn)}")


@app.command()
@grouped
def recommend(
    folder: Folder,
    chosen: LimitOptions,
    traffic: Annotated[str | None, typer.Option(help="Only in this traffic; default: all of the study.")] = None,
    world: Annotated[str | None, typer.Option(help="Only over this world; default: all of the study.")] = None,
) -> None:
    """Recommend the altitude and policy with the best mean coverage within limits, with the certainty of the choice.

    --choose selects the highest, the fastest or the one with the least energy among those that find enough.

    Sensor and preset are assumptions of a study: each combination has its own recommendation.

    \b
    pavetwin experiment recommend studies/first --traffic los-E --max-time 120
    pavetwin experiment recommend studies/first --max-energy 5 --min-coverage 80
    pavetwin experiment recommend studies/first --choose highest --min-coverage 25
    """
    from pavetwin.experiments.advice import advise
    from pavetwin.experiments.store import Store

    limits, objective = chosen.limits(), chosen.chosen_objective()
    store = Store(folder)
    table = store.table()
    for option, column, value in (("traffic", "traffic", traffic), ("world", "world", world)):
        if value is not None:
            levels = table[column].unique(maintain_order=True).to_list()
            if value not in levels:
                raise PaveTwinError(f"`{option}` {value}: the study has {', '.join(levels)}.")
            table = table.filter(table[column] == value)
    design = store.design()
    advice = advise(table, limits, objective=objective, seed=design.seed, design=design.model_dump(mode="json"))
    for each in advice:
        if each.assumption:
            out.print(f"\n[bold]{each.assumption}[/]")
        out.print(_options_table(each.recommendation))
        out.line("\n".join(each.sentences))
    _note_unfinished(store)
    if any(each.recommendation.best is None and each.recommendation.is_measured for each in advice):
        raise typer.Exit(FAILED_CODE)


def _note_unfinished(store: "Store") -> None:
    from pavetwin.experiments.metrics import REPLICATE
    from pavetwin.experiments.units import cells_of, units_of

    design, table = store.design(), store.table()
    flown = table.select(table.columns[: table.columns.index(REPLICATE) + 1]).n_unique()
    planned = len(units_of(design)) * len(cells_of(design, store.owners()))
    if flown < planned:
        out.print(f"[yellow]Note:[/] only {flown} of {planned} missions are flown; run the study again.")


def _options_table(chosen: "Recommendation") -> "Table":
    from rich.table import Table

    from pavetwin.experiments.report.proposals import options_table

    made = options_table(chosen)
    table = Table(box=None, header_style="bold", pad_edge=False, padding=(0, 1, 0, 0))
    texts = [[cell.text.replace("\u00a0", " ") for cell in row] for row in made.rows]
    for at, (head, *cells) in enumerate(zip(made.heads, *texts, strict=True)):
        # An interval may wrap below its mean, but is never shortened.
        longest = max(len(word) for text in (head, *cells) for word in text.split())
        justify: Literal["left", "right"] = "left" if at < made.lead or head == "Remark" else "right"
        table.add_column(head, justify=justify, min_width=longest)
    for cells, is_feasible in zip(texts, chosen.options["feasible"], strict=True):
        table.add_row(*cells, style="" if is_feasible else "dim")
    return table


def _engine(name: str, scheduler: str | None, jobs: int | None, design: "Design") -> "Engine":
    from pavetwin.experiments.engine import Pool, Single

    workers = jobs or os.cpu_count() or 1
    if name == "dask":
        from pavetwin.experiments.engine import Cluster

        return Cluster(scheduler=scheduler, jobs=workers)
    if name != "local":
        raise PaveTwinError(f"`engine` {name}: known are local and dask.")
    if scheduler is not None:
        raise PaveTwinError("`scheduler`: only with --engine dask.")
    units = len(design.worlds) * design.replicates
    return Single() if min(workers, units) == 1 else Pool(workers)


def _print_run(ran: "Ran", folder: Path) -> None:
    total = ran.plan.missions
    before = f", {total - ran.missions_flown} of them before" if ran.missions_flown < total else ""
    presets = f"preset{'s' * (len(ran.plan.design.presets) > 1)} {', '.join(ran.plan.design.presets)}"
    parts = f"{len(ran.plan.units)} parts in {folder}/segments.parquet/"
    rows = ran.plan.segment_missions
    each = f", {rows} segment missions, one row each" if rows > total else ""
    out.line(f"{total} missions flown{before}, {presets}{each}: {parts}")
    failed = sum(ran.failures.values())
    if failed:
        out.print(f"[yellow]{failed} of {ran.table.height} segment missions failed:[/]")
        for reason, count in list(ran.failures.items())[:MOST_REASONS]:
            out.line(f"  {count} × {reason}")
        out.line(
            "Fix the cause and run the same command with --retry-failed. Missions of a file that you changed (a "
            "policy, a sensor, a plugin, routes) are flown again without it."
        )
    out.line(f"Next: pavetwin experiment report {quote(str(folder))}")
