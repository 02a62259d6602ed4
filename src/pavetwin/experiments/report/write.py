"""Writes a study's report and tables, each whole or not at all."""

from collections.abc import Callable
from pathlib import Path

from pavetwin.experiments.report import tables
from pavetwin.experiments.report.study import Study
from pavetwin.files import writing
from pavetwin.reports.page import figure_files


def write_report(
    study: Study, folder: Path, on_progress: Callable[[float], None] | None = None, *, figures: bool = False
) -> list[Path]:
    """Write `report.html`, `table.csv`, `table.md`, `table.tex` and, where something is compared in pairs,
    `differences.csv` into `folder`. The same study gives the same bytes.

    Args:
        on_progress: told the share done.
        figures: write each figure also as a file of its own, `figures/figure-N.svg`; maps as PNG.

    Returns:
        The files.

    Raises:
        PaveTwinError: one cannot be written; it is then as it was before.
    """
    from pavetwin.experiments.report import page

    report = on_progress or (lambda _: None)
    sections = page.sections_of(study, report)
    files = {
        "report.html": page.page(study, sections).encode(),
        "table.csv": tables.csv(study.summary).encode(),
        "table.md": tables.markdown(study).encode(),
        "table.tex": tables.latex(study).encode(),
    }
    if study.comparisons:
        files["differences.csv"] = tables.differences_csv(study).encode()
    if figures:
        files |= figure_files(sections)
    for name, content in files.items():
        with writing(folder / name) as temporary:
            temporary.write_bytes(content)
    report(1.0)
    return [folder / name for name in files]
