"""Defects are placed once and kept in the cache, the same to the bit."""

from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path

import pytest

from pavetwin.defects import DefectKind, DefectOptions, place, placed_on
from pavetwin.defects import placement as placed
from pavetwin.experiments import fly_unit
from pavetwin.mission.inputs import defects_of
from pavetwin.mission.spec import DefectInput
from pavetwin.world.cache import placed_folder
from pavetwin.world.folder import CACHE_VARIABLE
from pavetwin.world.model import Defect, World
from scenes import tiny

OPTIONS = DefectOptions(population="paper", per_segment=3)
STREETS = [tiny.street(name, (0.0, y), (30.0, y)) for name, y in (("one", 0.0), ("two", 50.0))]


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> World:
    """Two streets with a content hash, as every world has that was built, and an empty cache."""
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    return replace(tiny.world(STREETS, ()), content_hash="5")


def values(defects: Sequence[Defect]) -> list[object]:
    rows = [[getattr(each, field.name) for field in fields(each)] for each in defects]
    return [[getattr(value, "wkb", value) for value in row] for row in rows]


def files() -> list[Path]:
    return list(placed_folder().iterdir()) if placed_folder().is_dir() else []


def test_a_second_process_reads_the_same_to_the_bit(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    first = placed_on(world, world.segments, 7, OPTIONS)
    assert values(first) == values(place(world.segments, 7, OPTIONS))
    assert len(files()) == 1
    monkeypatch.setattr(placed, "place", lambda *_, **__: pytest.fail("placed, and not read from the cache"))
    found = placed_on(world, world.segments, 7, OPTIONS, threads=1)
    assert values(found) == values(first)
    assert all(type(a.severity) is type(b.severity) for a, b in zip(found, first, strict=True))


def test_other_inputs_are_other_files(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(placed, "place", lambda *_, **__: ())

    def file_of(world: World, seed: int = 7, options: DefectOptions = OPTIONS, count: int = 2) -> str:
        before = set(files())
        placed_on(world, world.segments[:count], seed, options)
        return str({*files()} - before)

    names = [
        file_of(world),
        file_of(world, seed=8),
        file_of(world, count=1),
        file_of(world, options=DefectOptions(population="survey")),
        file_of(replace(world, content_hash="6")),
    ]
    monkeypatch.setattr(placed, "made_by", lambda *_: "by other code")
    names.append(file_of(world))
    assert len({*names}) == len(names) == len(files())


def test_nothing_is_kept_of_a_world_without_a_hash_or_of_classes_of_a_users_own(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    placed_on(replace(world, content_hash=""), world.segments[:1], 7, OPTIONS)
    monkeypatch.setattr(DefectKind, "ships", False)
    monkeypatch.setattr(placed, "place", lambda *_, **__: ())
    placed_on(world, world.segments[:1], 7, OPTIONS)
    assert not files()


def test_missions_and_studies_find_theirs_there(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    place_of_unit = fly_unit._Place("a.yaml", world.content_hash, (0,), 7, OPTIONS.model_dump_json())
    monkeypatch.setattr(fly_unit, "world_of_study", lambda *_: world)
    source = DefectInput(seed=7, options=OPTIONS)
    first = [defects_of(world, source), fly_unit._defects.__wrapped__(place_of_unit)]
    assert len(files()) == 2
    monkeypatch.setattr(placed, "place", lambda *_, **__: pytest.fail("placed, and not read from the cache"))
    again = [defects_of(world, source), fly_unit._defects.__wrapped__(place_of_unit)]
    assert [*map(values, again)] == [*map(values, first)]
