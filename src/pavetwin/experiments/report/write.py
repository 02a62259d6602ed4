"""Writes a study's report and tables, each whole or not at all."""

from collections.abc import Callable
from pathlib import Path

from pavetwin.experiments.report import tables
from pavetwin.experiments.report.study import Study
from pavetwin.files import writing


def write_report(study: Study, folder: Path, on_progress: Callable[[float], None] | None = None) -> list[Path]:
    """Write `report.html`, `table.csv`, `table.md` and `table.tex` into `folder`. The same study gives the same bytes.

    Args:
        on_progress: told the share done.

    Returns:
        The files.

    Raises:
        PaveTwinError: one cannot be written; it is then as it was before.
    """
    from pavetwin.experiments.report.page import page

    tell = on_progress or (lambda _: None)
    texts = {
        "table.csv": tables.csv(study.summary),
        "table.md": tables.markdown(study),
        "table.tex": tables.latex(study),
        "report.html": page(study, tell),
    }
    paths = [folder / name for name in texts]
    for path, text in zip(paths, texts.values(), strict=True):
        with writing(path) as temporary:
            temporary.write_text(text, encoding="utf-8", newline="")
    tell(1.0)
    return [paths[-1], *paths[:-1]]
