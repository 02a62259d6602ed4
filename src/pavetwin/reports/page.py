"""Pages of reports: one HTML file that needs no network, no script and no installed font."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

from pavetwin.draw import style
from pavetwin.reports.blocks import Block, ReportFigure, Section, Table


def render(package: str, template: str, **values: Any) -> str:
    """Fill a template of a package. It may use the templates of this package, and the colours of the drawings."""
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(package, "."), PackageLoader("pavetwin.reports", ".")]),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters["identity"] = id
    colours = {"accent": style.BASE, "ink": style.INK, "soft": style.INK_SOFT}
    return environment.get_template(template).render(**colours, **values).lstrip()


def figures_of(sections: Sequence[Section]) -> list[ReportFigure]:
    """The figures of sections and their subsections, in the order of the page."""
    return [block for block in _blocks(sections) if isinstance(block, ReportFigure)]


def figure_files(sections: Sequence[Section]) -> dict[str, bytes]:
    """Each figure as a file: `figures/figure-1.svg` and so on."""
    return {
        f"figures/figure-{at}.{'jpg' if figure.suffix == 'jpeg' else figure.suffix}": figure.content
        for at, figure in enumerate(figures_of(sections), start=1)
    }


def block_numbers(sections: Sequence[Section]) -> dict[int, int]:
    """The number of each figure and each table by the `id` of its block, in the order of the page."""
    tables = [block for block in _blocks(sections) if isinstance(block, Table)]
    return {id(block): at for blocks in (figures_of(sections), tables) for at, block in enumerate(blocks, start=1)}


def _blocks(sections: Iterable[Section]) -> Iterator[Block]:
    for section in sections:
        yield from section.blocks
        yield from _blocks(section.sections)
