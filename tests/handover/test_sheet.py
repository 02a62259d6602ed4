"""Text on the printed page."""

from hypothesis import given
from hypothesis import strategies as st

from pavetwin.draw import style
from pavetwin.handover.sheet import wrapped
from pavetwin.policies import Hover, Pilot

WORDS = st.lists(st.text("abcdefgh ÄЖω", min_size=1, max_size=14).map(lambda word: word.replace(" ", "x")), min_size=1)


@given(WORDS, st.floats(0.5, 4.0))
def test_lines_keep_every_word_and_fit(words: list[str], width_in: float) -> None:
    lines = wrapped(" ".join(words), 8.0, width_in)
    assert " ".join(lines).split() == words
    assert all(style.text_width_pt(line, 8.0) <= 72 * width_in for line in lines if " " in line)


def test_no_text_is_no_line() -> None:
    assert wrapped("", 8.0, 3.0) == []


def test_a_policy_made_from_another_says_nothing_of_who_can_fly_it() -> None:
    class Changed(Hover):
        pass

    assert (Changed.pilot, Changed.by_hand) == (Pilot.UNKNOWN, "")
    assert Hover.pilot is Pilot.OBSERVER
