"""What is damaged on each segment, counted from the defects themselves."""

from pathlib import Path

import pyogrio
import pytest

from pavetwin.defects import DefectOptions, add_defects
from pavetwin.draw.condition_maps import DENSITY_COLOURS, STEPS, save_condition_map, shade_of
from pavetwin.world.condition import condition_columns, condition_of
from pavetwin.world.store import save_world
from scenes import built

DAMAGED = add_defects(built("cross"), DefectOptions(population="survey", per_100_m2=3))


def test_each_segment_has_the_extent_of_its_own_defects() -> None:
    world = DAMAGED.world
    for each in condition_of(world):
        own = [defect for defect in world.defects if defect.segment == each.segment.id]
        cracks = [defect for defect in own if defect.kind == "single_crack"]
        assert each.number == len(own)
        assert each.of("single_crack").number == len(cracks)
        assert each.of("single_crack").length_m == pytest.approx(sum(defect.length_m for defect in cracks))
        assert each.damaged_share == pytest.approx(sum(d.polygon.area for d in own) / each.segment.polygon.area)
        assert each.per_100_m2 == pytest.approx(100 * len(own) / each.segment.polygon.area)
        assert each.of("no_such_class").number == 0


def test_the_geopackage_has_it_as_a_layer(tmp_path: Path) -> None:
    save_world(DAMAGED, tmp_path / "w")
    meta, _, shapes, columns = pyogrio.raw.read(tmp_path / "w" / "world.gpkg", layer="condition")
    table = dict(zip(meta["fields"], columns, strict=True))
    assert len(shapes) == len(DAMAGED.world.segments)
    assert table["defects"].sum() == len(DAMAGED.world.defects)
    assert table["segment"].tolist() == [segment.id for segment in DAMAGED.world.segments]
    assert set(table) == set(condition_columns(DAMAGED.world))
    assert table["single_crack_number"].sum() == sum(d.kind == "single_crack" for d in DAMAGED.world.defects)


def test_shades_go_from_sound_to_worn(tmp_path: Path) -> None:
    assert [shade_of(value) for value in (0.0, 0.99, 1.0, 3.9, 8.0, 100.0)] == [0, 0, 1, 2, 4, 4]
    assert len(DENSITY_COLOURS) == len(STEPS) + 1
    save_condition_map(DAMAGED.world, tmp_path / "condition.svg")
    text = (tmp_path / "condition.svg").read_text(encoding="utf-8").lower()
    used = {DENSITY_COLOURS[shade_of(each.per_100_m2)].lower() for each in condition_of(DAMAGED.world)}
    assert len(used) > 1
    assert all(text.count(colour) > 1 for colour in used), "each shade is on the map and in the legend"
