"""Names of streets: in which letters, of streets that have none, and segments found by them."""

from dataclasses import replace
from pathlib import Path

import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.world.content import content_hash
from pavetwin.world.osm_file import latin_name
from pavetwin.world.store import load_world, save_world
from scenes import scripts


@pytest.mark.parametrize(
    ("tags", "expected"),
    [
        ({"name": "Липовая улица", "name:en": "Linden Street", "int_name": "Lipovaya"}, "Lipovaya"),
        ({"name": "青石路", "name:zh-Latn-pinyin": "Qīngshí Lù"}, "Qīngshí Lù"),
        ({"name": "青石路", "name:ja_rm": "Seiseki", "alt_name": "青路"}, "Seiseki"),
        ({"name": "青石路", "alt_name": "青路"}, ""),
        ({"name": "青石路", "alt_name": "Bluestone"}, "Bluestone"),
        ({"name": "青石路 Bluestone", "name:en": "Bluestone"}, "Bluestone"),
        ({"name": "Rue Haute", "name:en": "High Street"}, ""),
        ({"name:en": "High Street"}, ""),
    ],
)
def test_a_name_in_latin_letters_is_taken_from_the_tags(tags: dict[str, str], expected: str) -> None:
    assert latin_name(tags) == expected


@pytest.mark.parametrize("script", scripts.TOWNS)
def test_a_world_keeps_both_names(script: str, tmp_path: Path) -> None:
    made, town = scripts.built(script), scripts.TOWNS[script]
    assert made.world.left_hand is town.left_hand
    names = {street.name: street.latin_name for street in made.world.streets}
    for tags in town.streets:
        assert names[tags["name"]] == latin_name(tags)
    assert load_world(save_world(made, tmp_path / "town").folder or "").streets == made.world.streets


def test_names_in_latin_letters_are_not_part_of_the_content() -> None:
    world = scripts.built("chinese").world
    other = replace(world, streets=tuple(replace(street, latin_name="") for street in world.streets))
    assert other != world
    assert content_hash(other, "") == content_hash(world, "")
    renamed = replace(world, streets=tuple(replace(street, name="x") for street in world.streets))
    assert content_hash(renamed, "") != content_hash(world, "")


def test_a_street_without_a_name_is_called_so() -> None:
    world = scripts.built("cyrillic").world
    (unnamed,) = (segment for segment in world.segments if not segment.has_street_name)
    assert unnamed.street == "104"
    assert unnamed.street_name == unnamed.label == f"unnamed street, {unnamed.id}"
    named = next(segment for segment in world.segments if segment.has_street_name)
    assert (named.street_name, named.label) == (named.street, f"{named.street}, {named.id}")


def test_a_street_against_its_drawing_has_no_name_either() -> None:
    (unnamed,) = (segment for segment in scripts.built("cyrillic").world.segments if not segment.has_street_name)
    assert not replace(unnamed, edges=("-104",)).has_street_name


def test_segments_are_found_by_id_and_by_their_street() -> None:
    world = scripts.built("chinese").world
    street = [segment for segment in world.segments if segment.street == "青石路"]
    assert len(street) > 1
    for name in ("青石路", "Bluestone Road", " bluestone road"):
        assert list(world.segments_named(name)) == street
    assert world.segments_named(street[1].id) == (street[1],)


@pytest.mark.parametrize(
    ("name", "near"), [("Blustone Road", "'Bluestone Road'"), ("青石街", "'青石路'"), ("s1", "'s0001'")]
)
def test_an_unknown_name_gets_the_nearest(name: str, near: str) -> None:
    with pytest.raises(PaveTwinError, match=rf"No segment or street '{name}'.*did you mean {near}"):
        scripts.built("chinese").world.segments_named(name)


def test_the_edge_of_an_unnamed_street_is_no_name() -> None:
    with pytest.raises(PaveTwinError):
        scripts.built("chinese").world.segments_named("104")
