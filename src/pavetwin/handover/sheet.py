"""The page of a handover on one sheet of A4, as a figure, with positions in inches."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from pavetwin.draw import style
from pavetwin.draw.fonts import font_properties, readable, shown_label
from pavetwin.handover.contents import Handover
from pavetwin.handover.map import draw_map, legend_of, map_bounds
from pavetwin.handover.page import Page, PageTable, Paragraphs

A4_IN: Final = (8.268, 11.693)
MARGIN_IN: Final = 0.5
TEXT_IN: Final = 3.3
"""Width of the column of text."""
GAP_IN: Final = 0.22
LEAST_MAP_IN: Final = 3.6
"""Height of the map, at least."""
MOST_SEVERITIES: Final = 9
"""In the table of classes and severities."""
MOST_STREETS: Final = 14
"""In the table of streets, where there is room."""

_TITLE_PT, _HEAD_PT, _TEXT_PT, _TABLE_PT, _FOOT_PT = 15.0, 8.6, 7.6, 7.2, 6.6
_LINE: Final = 1.32  # Distance of lines, in sizes of the letters
_ROW_IN: Final = 0.148


def sheet_figure(page: Page, handover: Handover) -> Figure:
    """Draw the page; within `style.styled`. Rows of streets without room are left out, with a note."""
    figure = style.new_figure(*A4_IN)
    paper = style.panel(figure, 0, 0, *A4_IN)
    width = A4_IN[0] - 2 * MARGIN_IN
    y = _header(paper, page)
    *paragraphs, duty = page.paragraphs
    severities, streets = page.tables
    bottom = _footer(paper, duty, page.credit, width)
    text_end = _column(paper, paragraphs, MARGIN_IN, y, TEXT_IN)
    table_end = _table(paper, folded(severities), MARGIN_IN, text_end - 0.12, [TEXT_IN - 1.5, 0.5, 0.5, 0.5])
    map_in = A4_IN[0] - 2 * MARGIN_IN - TEXT_IN - GAP_IN
    legend_in = _ROW_IN * len(legend_of(handover)) + 0.1
    west, south, east, north = map_bounds(handover)
    wanted_in = max(map_in * (north - south) / (east - west), LEAST_MAP_IN)
    map_bottom = max(min(table_end + legend_in, y - LEAST_MAP_IN), y - wanted_in)
    axes = style.axes_in(figure, A4_IN[0] - MARGIN_IN - map_in, map_bottom, map_in, y - map_bottom)
    draw_map(axes, handover)
    _legend(paper, handover, A4_IN[0] - MARGIN_IN - map_in, map_bottom - 0.08, map_in, axes)
    _streets(paper, streets, handover, min(table_end, map_bottom - legend_in) - 0.16, bottom, width)
    return figure


def _header(paper: Axes, page: Page) -> float:
    """Title and main numbers; returns where the next part may begin."""
    y = A4_IN[1] - MARGIN_IN
    _write(paper, MARGIN_IN, y, _cut(page.title, _TITLE_PT, 7.2, bold=True), _TITLE_PT, bold=True)
    _write(paper, MARGIN_IN, y - 0.27, _cut(page.subtitle, _HEAD_PT, 7.2), _HEAD_PT, colour=style.INK_SOFT)
    y -= 0.52
    step = (A4_IN[0] - 2 * MARGIN_IN) / len(page.numbers)
    paper.plot([MARGIN_IN, A4_IN[0] - MARGIN_IN], [y, y], color=style.BASE, linewidth=1.2)
    for at, (name, value) in enumerate(page.numbers):
        _write(paper, MARGIN_IN + at * step, y - 0.08, name, 6.4, colour=style.INK_SOFT)
        _write(paper, MARGIN_IN + at * step, y - 0.21, _cut(value, 10.5, step - 0.06, bold=True), 10.5, bold=True)
    y -= 0.46
    paper.plot([MARGIN_IN, A4_IN[0] - MARGIN_IN], [y, y], color=style.INK_FAINT, linewidth=0.6)
    return y - 0.12


def _column(paper: Axes, paragraphs: Sequence[Paragraphs], x: float, y: float, width: float) -> float:
    for each in paragraphs:
        _write(paper, x, y, each.title, _HEAD_PT, bold=True, colour=style.BASE)
        y -= _HEAD_PT * _LINE / 72 + 0.02
        for sentence in each.sentences:
            for line in wrapped(sentence, _TEXT_PT, width):
                _write(paper, x, y, line, _TEXT_PT)
                y -= _TEXT_PT * _LINE / 72
            y -= 0.025
        y -= 0.07
    return y


def _footer(paper: Axes, duty: Paragraphs, credit: str, width: float) -> float:
    """The pilot's responsibility and whom the data come from, at the foot; returns its upper edge."""
    lines = [line for sentence in duty.sentences for line in wrapped(sentence, _FOOT_PT, width - 0.2)]
    step = _FOOT_PT * _LINE / 72
    top = MARGIN_IN + 0.17 + step * (len(lines) + 1) + 0.12
    paper.add_patch(
        Rectangle((MARGIN_IN, MARGIN_IN + 0.14), width, top - MARGIN_IN - 0.14, facecolor="#F6F4EF", edgecolor="none")
    )
    y = top - 0.06
    _write(paper, MARGIN_IN + 0.1, y, duty.title, _FOOT_PT, bold=True)
    for line in lines:
        y -= step
        _write(paper, MARGIN_IN + 0.1, y, line, _FOOT_PT)
    _write(paper, MARGIN_IN, MARGIN_IN + 0.07, credit, 5.8, colour=style.INK_SOFT)
    return top + 0.08


def folded(table: PageTable) -> PageTable:
    """The table of severities with at most `MOST_SEVERITIES` rows before the sums; the last is then that of others."""
    *rows, sums = table.rows
    if len(rows) <= MOST_SEVERITIES:
        return table
    kept, rest = rows[: MOST_SEVERITIES - 1], rows[MOST_SEVERITIES - 1 :]
    others = (f"{len(rest)} others", *(f"{sum(int(row[at]) for row in rest)}" for at in range(1, len(sums))))
    return replace(table, rows=(*kept, others, sums))


def _legend(paper: Axes, handover: Handover, x: float, y: float, width: float, town: Axes) -> None:
    """Draw the legend below the map, with scale bar and north arrow."""
    box = (x / A4_IN[0], y / A4_IN[1])
    paper.legend(
        handles=[entry.handle for entry in legend_of(handover)], loc="upper left", bbox_to_anchor=box, fontsize=6.6,
        borderpad=0, borderaxespad=0, labelspacing=0.42, handlelength=1.7,
    )  # fmt: skip
    west, east = town.get_xlim()
    style.scale_bar(paper, x + width - 0.4, y - 0.2, width / (east - west), longest=1.5)
    style.north_arrow(paper, x + width - 0.1, y - 0.16, 0.22)


def _streets(paper: Axes, table: PageTable, handover: Handover, y: float, bottom: float, width: float) -> None:
    """Number of streets that fit."""
    note = wrapped(table.note, _FOOT_PT, width)
    step = _FOOT_PT * _LINE / 72
    room = int((y - bottom - 0.62 - step * (len(note) + 1)) / _ROW_IN)
    rows = table.rows[: max(1, min(room, MOST_STREETS))]
    names = _names(handover)
    widths = [width - 0.62 * 5 - 0.95, 0.62, 0.62, 0.75, 0.55, 0.55, 0.95]
    if len(table.heads) > len(widths):
        widths = [width - 5.25, 0.52, 0.56, 0.68, 0.5, 0.5, 0.79, 1.2, 0.5]
    else:
        widths[0] = width - sum(widths[1:])
    shown = tuple((names.get(row[0], row[0]), *row[1:]) for row in rows)
    y = _table(paper, PageTable(table.title, table.heads, shown), MARGIN_IN, y, widths)
    if left := len(table.rows) - len(rows):
        note = wrapped(f"And {left} more in streets.csv. {table.note}", _FOOT_PT, width)
    for line in note:
        _write(paper, MARGIN_IN, y, line, _FOOT_PT, colour=style.INK_SOFT)
        y -= step


def _names(handover: Handover) -> dict[str, str]:
    """Substitute names for streets whose names no installed font can show."""
    world = handover.world
    first = {row["street"]: row["segments"].split()[0] for row in handover.streets.iter_rows(named=True)}
    return {name: shown_label(world, world.segment(each)) for name, each in first.items() if not readable(name)}


def _table(paper: Axes, table: PageTable, x: float, y: float, widths: Sequence[float]) -> float:
    """A table, its first column and those of words on the left; returns its lower edge."""
    _write(paper, x, y, table.title, _HEAD_PT, bold=True, colour=style.BASE)
    y -= _HEAD_PT * _LINE / 72 + 0.03
    lefts = [x + sum(widths[:at]) for at in range(len(widths))]
    words = [table.is_words(at) for at in range(len(widths))]
    heads = [wrapped(head, 6.4, width) for head, width in zip(table.heads, widths, strict=True)]
    lines = max(map(len, heads))
    for left, width, head, is_words in zip(lefts, widths, heads, words, strict=True):
        for number, line in enumerate(head):
            at = y - (lines - len(head) + number) * 6.4 * 1.15 / 72
            _cell(paper, left, width, at, line, 6.4, left_aligned=is_words, colour=style.INK_SOFT)
    y -= lines * 6.4 * 1.15 / 72 + 0.03
    paper.plot([x, x + sum(widths)], [y, y], color=style.INK_SOFT, linewidth=0.6)
    y -= 0.025
    for row in table.rows:
        for left, width, text, is_words in zip(lefts, widths, row, words, strict=True):
            _cell(paper, left, width, y, _cut(text, _TABLE_PT, width - 0.06), _TABLE_PT, left_aligned=is_words)
        y -= _ROW_IN
        paper.plot([x, x + sum(widths)], [y + 0.01, y + 0.01], color="#E5E2DC", linewidth=0.4)
    return y - 0.04


def _cell(
    paper: Axes, left: float, width: float, y: float, text: str, size: float, *, left_aligned: bool,
    colour: str = style.INK,
) -> None:  # fmt: skip
    if left_aligned:
        _write(paper, left + (0.06 if left > MARGIN_IN else 0), y, text, size, colour=colour)
    else:
        _write(paper, left + width, y, text, size, colour=colour, right=True)


def _write(
    paper: Axes, x: float, y: float, text: str, size: float, *, bold: bool = False, colour: str = style.INK,
    right: bool = False,
) -> None:  # fmt: skip
    """A line of text whose upper corner is at a place."""
    properties = font_properties(text, bold=bold, size=size)
    paper.text(x, y, text, fontproperties=properties, color=colour, va="top", ha="right" if right else "left")


def wrapped(text: str, size: float, width: float) -> list[str]:
    """Lines of words that are no wider than `width` inches; a longer word has a line of its own."""
    lines = list[str]()
    for word in text.split(" "):
        if lines and style.text_width_pt(f"{lines[-1]} {word}", size) <= 72 * width:
            lines[-1] += f" {word}"
        else:
            lines.append(word)
    return lines if text else []


def _cut(text: str, size: float, width: float, *, bold: bool = False) -> str:
    """A text with an ellipsis at its end where it is wider than `width` inches."""
    shown, kept = text, len(text)
    while kept and style.text_width_pt(shown, size, bold=bold) > 72 * width:
        kept -= 1
        shown = f"{text[:kept].rstrip()}…"
    return shown
