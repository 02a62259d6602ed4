"""Made-up towns whose streets have names in four scripts: a grid of two by two streets and an unnamed lane."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from pavetwin.defects import DefectOptions, add_defects
from pavetwin.world.build import BuildOptions, Built, build_world


@dataclass(frozen=True)
class Town:
    streets: tuple[dict[str, str], ...]
    """The tags of the names of two streets to the east, then of two to the north."""
    origin: tuple[float, float]
    """Latitude and longitude."""
    left_hand: bool = False


TOWNS = {
    "chinese": Town(
        (
            {"name": "青石路", "name:en": "Bluestone Road"},
            {"name": "和風東路一段", "name:zh-Latn-pinyin": "Héfēng Dōng Lù Yī Duàn"},
            {"name": "柳岸街", "name:en": "Willow Bank Street"},
            {"name": "無英名巷"},
        ),
        (25.03, 121.53),
    ),
    "arabic": Town(
        (
            {"name": "شارع النخيل", "name:en": "Palm Street"},
            {"name": "طريق الواحة", "int_name": "Oasis Road"},
            {"name": "شارع المرفأ", "name:en": "Harbour Street"},
            {"name": "زقاق الورد"},
        ),
        (30.05, 31.24),
    ),
    "cyrillic": Town(
        (
            {"name": "Липовая улица", "name:en": "Linden Street"},
            {"name": "проспект Рассвета", "int_name": "Rassveta Avenue"},
            {"name": "Кленовая улица", "name:en": "Maple Street"},
            {"name": "Тихий переулок"},
        ),
        (55.75, 37.62),
    ),
    "devanagari": Town(
        (
            {"name": "नीलम मार्ग", "name:en": "Sapphire Road"},
            {"name": "पीपल पथ", "int_name": "Peepal Path"},
            {"name": "संगीत विद्यालय मार्ग", "name:en": "Music School Road"},
            {"name": "कमल गली"},
        ),
        (26.91, 75.79),
        left_hand=True,
    ),
}


def extract(town: Town) -> str:
    """The map of a town: streets 220 m long that cross 110 m apart, and a lane off the first."""
    lat, lon = town.origin
    places = {10 * x + y: (lat + 0.001 * y, lon + 0.0011 * x) for x in range(4) for y in range(4)}
    ways = [((1, 11, 21, 31), town.streets[0]), ((2, 12, 22, 32), town.streets[1])]
    ways += [((10, 11, 12, 13), town.streets[2]), ((20, 21, 22, 23), town.streets[3]), ((31, 30), {})]
    lines = ["<?xml version='1.0' encoding='UTF-8'?>", '<osm version="0.6" generator="by hand">']
    lines += [f'<node id="{k + 1}" version="1" lat="{at[0]:.6f}" lon="{at[1]:.6f}"/>' for k, at in places.items()]
    for number, (nodes, names) in enumerate(ways, 100):
        tags = {"highway": "residential", "maxspeed": "30", **names}
        refs = "".join(f'<nd ref="{node + 1}"/>' for node in nodes)
        texts = "".join(f'<tag k="{key}" v="{value}"/>' for key, value in tags.items())
        lines.append(f'<way id="{number}" version="1">{refs}{texts}</way>')
    return "\n".join([*lines, "</osm>", ""])


@cache
def built(script: str) -> Built:
    """The world of a town, with a few defects."""
    with TemporaryDirectory() as folder:
        source = Path(folder) / f"{script}.osm"
        source.write_text(extract(TOWNS[script]), encoding="utf-8")
        made = build_world(source, BuildOptions(seed=1, left_hand=TOWNS[script].left_hand))
    return add_defects(made, DefectOptions(population="paper", per_segment=4))
