"""Text on the printed page."""

from hypothesis import given
from hypothesis import strategies as st

from pavetwin.draw import style
from pavetwin.handover.page import PageTable
from pavetwin.handover.sheet import MOST_SEVERITIES, folded, wrapped
from pavetwin.policies import Hover, Pilot

WORDS = st.lists(st.text("abcdefgh ÄЖω", min_size=1, max_size=14).map(lambda word: word.replace(" ", "x")), min_size=1)


@given(WORDS, st.floats(0.5, 4.0))
def test_lines_keep_every_word_and_fit(words: list[str], width_in: float) -> None:
    lines = wrapped(" ".join(words), 8.0, width_in)
    assert " ".join(lines).split() == words
    assert all(style.text_width_pt(line, 8.0) <= 72 * width_in for line in lines if " " in line)


def test_no_text_is_no_line() -> None:
    assert wrapped("", 8.0, 3.0) == []


def test_a_derived_policy_does_not_inherit_its_pilot() -> None:
    class Changed(Hover):
        pass

    assert (Changed.pilot, Changed.by_hand) == (Pilot.UNKNOWN, "")
    assert Hover.pilot is Pilot.OBSERVER


@given(st.lists(st.tuples(st.integers(0, 50), st.integers(0, 50)), min_size=1, max_size=30))
def test_a_long_table_of_severities_is_folded_and_its_sums_stay(counts: list[tuple[int, int]]) -> None:
    lines = [(f"c{at}", f"{found + missed}", f"{found}", f"{missed}") for at, (found, missed) in enumerate(counts)]
    sums = ("all", *(f"{sum(int(line[at]) for line in lines)}" for at in (1, 2, 3)))
    table = folded(PageTable("t", ("class, severity", "defects", "found", "missed"), (*lines, sums)))
    *rows, last = table.rows
    assert last == sums
    assert len(rows) == min(len(lines), MOST_SEVERITIES)
    assert all(sum(int(row[at]) for row in rows) == int(sums[at]) for at in (1, 2, 3))
