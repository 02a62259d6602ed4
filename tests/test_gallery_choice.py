"""Which streets and frames the gallery's sheets show."""

import numpy as np
import pytest
from gallery.frame_matcher import like_reflectance
from gallery.renderer import GREY
from gallery.streets import Place, varied
from PIL import Image


def place(street: str, pavement: str, *markings: str, town: int = 0, damage_m2: float = 0.0) -> Place:
    return Place(town, street, 0.0, 0.0, 0.0, pavement, "Germany", frozenset(markings), damage_m2)


def test_every_pavement_and_marking_comes_before_any_is_shown_twice() -> None:
    places = [
        place("a", "asphalt", damage_m2=9.0),
        place("b", "asphalt", "crossing", "hatching"),
        place("c", "concrete"),
        place("d", "asphalt", "bus_stop"),
    ]
    assert {each.street for each in varied(places, [3])} == {"b", "c", "d"}


def test_each_street_is_shown_once_and_each_town_has_its_share() -> None:
    places = [place(street, "asphalt", town=town) for town in (0, 1) for street in "aabbcc"]
    assert [each.town for each in varied(places, [2, 1])] == [0, 0, 1]
    assert len({(each.town, each.street) for each in varied(places, [5, 5])}) == 6


def test_of_places_that_show_the_same_the_most_damaged_is_taken() -> None:
    places = [place("a", "asphalt", damage_m2=0.1), place("b", "asphalt", damage_m2=2.0)]
    assert [each.street for each in varied(places, [1])] == ["b"]


def test_a_darker_photograph_asks_for_a_darker_pavement() -> None:
    def grey(level: int) -> Image.Image:
        return Image.fromarray(np.full((64, 64, 3), level, dtype=np.uint8))

    assert like_reflectance(grey(158)) == pytest.approx(GREY)
    assert like_reflectance(grey(80)) < 0.05 < GREY < like_reflectance(grey(190)) < 0.3
