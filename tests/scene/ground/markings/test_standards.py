"""Marking standards from data files: by place, by a style, and what is wrong with a file in one line."""

from importlib.resources import files
from pathlib import Path

import pytest
import yaml

from pavetwin.errors import PaveTwinError
from pavetwin.scene.ground import plan_ground
from pavetwin.scene.ground.markings.painter import FALLBACK, paint, standard_at, standard_of
from pavetwin.scene.ground.styles import street_style, style_sha256
from pavetwin.scene.ground.styles.marking_standard import marking_standard, standard_names
from pavetwin.scene.ground.styles.pavement import PACKAGE
from scenes import built, tiny

CITIES = {
    "china": {
        "Beijing": (116.4, 39.9), "Shanghai": (121.47, 31.23), "Chengdu": (104.07, 30.67),
        "Guangzhou": (113.26, 23.13), "Shenzhen": (114.06, 22.54), "Harbin": (126.63, 45.75),
        "Kunming": (102.71, 25.04), "Urumqi": (87.6, 43.8), "Kashgar": (75.99, 39.47), "Lhasa": (91.1, 29.65),
        "Sanya": (109.5, 18.25),
    },
    "france": {
        "Paris": (2.35, 48.86), "Lyon": (4.83, 45.76), "Marseille": (5.37, 43.3), "Bordeaux": (-0.58, 44.84),
        "Lille": (3.06, 50.63), "Strasbourg": (7.75, 48.58), "Nice": (7.27, 43.7), "Brest": (-4.49, 48.39),
        "Ajaccio": (8.74, 41.93),
    },
    "united_kingdom": {
        "London": (-0.13, 51.51), "Edinburgh": (-3.19, 55.95), "Belfast": (-5.93, 54.6), "Cardiff": (-3.18, 51.48),
        "Plymouth": (-4.14, 50.37),
    },
    "united_states": {
        "Seattle": (-122.33, 47.61), "Miami": (-80.19, 25.76), "Boston": (-71.06, 42.36), "Detroit": (-83.05, 42.33),
        "Houston": (-95.37, 29.76), "San Diego": (-117.16, 32.72), "El Paso": (-106.49, 31.76),
        "Anchorage": (-149.9, 61.22), "Honolulu": (-157.86, 21.31), "San Juan": (-66.1, 18.46),
    },
    FALLBACK: {
        "Taipei": (121.57, 25.03), "Hong Kong": (114.16, 22.28), "Delhi": (77.21, 28.61), "Jaipur": (75.79, 26.91),
        "Kolkata": (88.36, 22.57), "Kathmandu": (85.32, 27.72), "Hanoi": (105.85, 21.03),
        "Ulaanbaatar": (106.92, 47.89), "Vladivostok": (131.89, 43.12), "Seoul": (126.98, 37.57),
        "Bilbao": (-2.94, 43.26), "Bern": (7.45, 46.95), "Geneva": (6.14, 46.2), "Brussels": (4.35, 50.85),
        "Turin": (7.69, 45.07), "Dublin": (-6.26, 53.35), "Toronto": (-79.38, 43.65), "Montreal": (-73.57, 45.5),
        "Vancouver": (-123.12, 49.28), "Windsor": (-83.02, 42.29), "Tijuana": (-117.02, 32.51),
        "Monterrey": (-100.32, 25.69), "Berlin": (13.4, 52.52), "Munich": (11.58, 48.14),
    },
}  # fmt: skip
"""Longitude and latitude of cities, by the standard that holds there."""


@pytest.mark.slow
@pytest.mark.parametrize(("town", "name"), [("berlin_neukoelln", "germany"), ("seattle_roosevelt", "united_states")])
def test_the_place_decides_the_standard(town: str, name: str) -> None:
    assert standard_of(built(town).world) == marking_standard(name)


@pytest.mark.parametrize(("name", "city"), [(name, city) for name, cities in CITIES.items() for city in cities])
def test_cities_on_both_sides_of_a_border_have_their_own_standard(name: str, city: str) -> None:
    assert standard_at(*CITIES[name][city]) == marking_standard(name)


def test_standards_differ_in_what_one_sees() -> None:
    seen = [
        (each.lane_dash_m, each.centre_colour, each.stripe_m, each.stop_m)
        for each in map(marking_standard, standard_names())
    ]
    assert len(seen) == len(set(seen)) >= 5


def test_a_style_may_ask_for_a_standard_of_its_own(tmp_path: Path) -> None:
    text = (files(PACKAGE) / "standards" / "germany.yaml").read_text(encoding="utf-8")
    mine = tmp_path / "mine.yaml"
    mine.write_text(yaml.safe_dump(yaml.safe_load(text) | {"centre_colour": "blue", "lane_dash_m": [1.0, 1.0]}))
    world = built("berlin_neukoelln").world
    before = plan_ground(world, 3, style=street_style("uniform")).paint
    after = plan_ground(world, 3, style=street_style("uniform").model_copy(update={"markings": str(mine)})).paint
    assert paint("blue") not in before.bar_paints[:, 0]
    assert (after.bar_paints[:, 0] == paint("blue")).sum() > 20


def style_with(folder: Path, markings: str) -> str:
    """A style that asks for markings."""
    text = "title: one\nmain: {concrete: 1}\nother: {concrete: 1}\nstretches: {share: 0, pavements: {overlay: 1}}\n"
    path = folder / "style.yaml"
    path.write_text(f"{text}markings: {markings}\n")
    return str(path)


def test_a_style_finds_a_standard_next_to_it_and_its_hash_covers_it(tmp_path: Path) -> None:
    text = (files(PACKAGE) / "standards" / "germany.yaml").read_text(encoding="utf-8")
    hashes = set()
    for colour in ("blue", "red"):
        folder = tmp_path / colour
        folder.mkdir()
        (folder / "mine.yaml").write_text(yaml.safe_dump(yaml.safe_load(text) | {"centre_colour": colour}))
        style = style_with(folder, "mine.yaml")
        assert plan_ground(tiny.straight(), 3, style=street_style(style)).standard.centre_colour == colour
        hashes.add(style_sha256(style))
    assert len(hashes) == 2


def test_an_outline_that_crosses_itself_is_refused(tmp_path: Path) -> None:
    text = (files(PACKAGE) / "standards" / "germany.yaml").read_text(encoding="utf-8")
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(yaml.safe_load(text) | {"areas": [[[0, 0], [1, 1], [1, 0], [0, 1]]]}))
    with pytest.raises(PaveTwinError, match=r"areas: .*outline 1 crosses itself"):
        marking_standard(str(path))
