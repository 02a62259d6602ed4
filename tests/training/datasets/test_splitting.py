"""Train, val and test of photographs: every class in its shares, scenes undivided."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.labels import SPLITS
from pavetwin.labels.common_form import (
    AnnotatedImage,
    Annotation,
    annotation_path,
    as_xml,
    class_names,
    write_description,
)
from pavetwin.training.datasets.splitting import USUAL_SHARES, split_dataset, split_groups, split_names

SHARES = (0.7, 0.2, 0.1)
BOX = (0, 0, 9, 9)


def image(name: str, group: str, *labels: str, split: str | None = None) -> AnnotatedImage:
    annotations = tuple(Annotation(label, BOX) for label in labels)
    attributes = {} if split is None else {"split": split}
    return AnnotatedImage(name, ".jpg", (64, 48), "uapd", name, group, annotations=annotations, attributes=attributes)


def town(images: int = 2400, seed: int = 4) -> list[AnnotatedImage]:
    """Images in scenes of 1 to 40, most with single cracks, few with potholes or people, and those in few scenes."""
    rng = np.random.default_rng(seed)
    made: list[AnnotatedImage] = []
    for scene in range(images):
        mix = rng.dirichlet((3.0, 0.5, 0.12, 0.06, 0.8))
        for _ in range(min(int(rng.geometric(0.12)), 40)):
            labels = rng.choice(class_names()[:5], size=rng.poisson(3.0), p=mix).tolist()
            made.append(image(f"i{len(made)}", f"scene {scene}", *labels))
        if len(made) >= images:
            break
    return made


def test_every_class_has_its_shares_and_no_scene_is_divided() -> None:
    images = town()
    assert len(images) >= 2400
    found = split_groups(images, SHARES, seed=0)
    reached: dict[str, Counter[str]] = {split: Counter() for split in SPLITS}
    totals: Counter[str] = Counter()
    for each in images:
        counted = Counter(["images", *(label.category or "" for label in each.labelled)])
        reached[found.splits[each.group]] += counted
        totals += counted
    assert len(totals) == 6
    assert min(totals.values()) < 0.05 * totals["images"] * 3
    for name, total in totals.items():
        for split, share in zip(SPLITS, SHARES, strict=True):
            assert abs(reached[split][name] / total - share) < 0.02, (name, split)
            assert found.shares[name][SPLITS.index(split)] == pytest.approx(reached[split][name] / total)
    assert set(found.splits) == {each.group for each in images}


def test_a_class_that_few_scenes_hold_has_its_shares_where_they_allow_it() -> None:
    """Vehicles of real aerial pictures: one scene has half of them, so no scene can be moved alone for the better."""
    held = {"one": 871, "two": 335, "three": 220, "four": 99, "five": 78, "six": 52}
    cars = [image(f"car {scene}", scene, *["Car"] * count) for scene, count in held.items()]
    cracks = [image(f"crack {at}", f"street {at}", "Single Crack") for at in range(300)]
    found = split_groups([*cars, *cracks], SHARES, seed=0)
    assert found.shares["Car"] == pytest.approx(SHARES, abs=0.01)
    assert found.shares["Single Crack"] == pytest.approx(SHARES, abs=0.01)


def test_a_rare_class_weighs_as_much_as_a_common_one() -> None:
    """20 people among 20,000 cracks: by numbers alone, where the people go would hardly matter."""
    rng = np.random.default_rng(2)
    cracks = rng.integers(20, 1000, 40).tolist()
    images = [image(f"c{at}", f"street {at}", *["Single Crack"] * count) for at, count in enumerate(cracks)]
    images += [image(f"p{at}", f"street {at}", *["Person"] * count) for at, count in enumerate((1, 2, 3, 4) * 2)]
    found = split_groups(images, SHARES, seed=0)
    assert found.shares["Person"] == pytest.approx((0.7, 0.2, 0.1), abs=1e-9)
    assert found.shares["Single Crack"] == pytest.approx((0.7, 0.2, 0.1), abs=0.02)


def test_the_usual_shares() -> None:
    assert USUAL_SHARES == (0.7, 0.2, 0.1)


def test_it_depends_on_the_seed_and_on_nothing_else() -> None:
    images = town(600)
    again = split_groups(reversed(images), SHARES, seed=0)
    assert split_groups(images, SHARES, seed=0).splits == again.splits
    assert split_groups(images, SHARES, seed=1).splits != again.splits


def test_captures_keep_their_own_split() -> None:
    images = town(600)
    captured = [image(f"c{at}", f"street {at}", "Car", split=SPLITS[at % 3]) for at in range(30)]
    found = split_groups([*images, *captured], SHARES, seed=0)
    assert [found.splits[f"street {at}"] for at in range(30)] == [SPLITS[at % 3] for at in range(30)]


def test_of_captures_that_show_one_place_the_split_of_most_counts_which_is_told() -> None:
    own = ("train", "val", "val", None)
    joined = [image(f"c{at}", "corner", "Car", split=split) for at, split in enumerate(own)]
    square = [image(f"d{at}", "square", split="test") for at in range(2)]
    found = split_groups([*town(300), *joined, *square], SHARES, seed=0)
    assert (found.splits["corner"], found.splits["square"]) == ("val", "test")
    (told,) = found.report
    assert str(told) == "corner: images given to train (1) are in val, with others that show the same place"


@pytest.mark.parametrize("moved", ["road-composite", "film"])
def test_scenes_that_were_joined_after_a_composite_was_made_are_refused_where_that_moves_it(moved: str) -> None:
    """Else one object would be in two splits: on the composite, and on the picture it is cut out of."""
    car = Annotation("Car", BOX, attributes={"cut_out": "film-000"})
    road = replace(image("road-composite", "street", split="train"), annotations=(car,))
    donor = image("film", "film", "Car", split="train")
    assert split_groups([*town(300), road, donor], SHARES, seed=0).splits["street"] == "train"
    group = {"road-composite": "street", "film": "film"}[moved]
    joined = [image(f"d{at}", group, split="val") for at in range(2)]
    with pytest.raises(PaveTwinError, match=f"'{moved}' shares an object .* in train, .* given to val; merge all"):
        split_groups([*town(300), road, donor, *joined], SHARES, seed=0)


def test_a_split_of_nothing_gets_nothing() -> None:
    found = split_groups(town(300), (0.8, 0.2, 0.0), seed=0)
    assert set(found.splits.values()) == {"train", "val"}


@pytest.mark.parametrize("shares", [(0.7, 0.2, 0.2), (0.7, 0.3), (1.1, -0.1, 0.0)])
def test_shares_that_are_none_are_refused(shares: tuple[float, ...]) -> None:
    with pytest.raises(PaveTwinError, match="must sum to 100 %"):
        split_groups(town(300), shares, seed=0)


def test_two_scenes_are_too_few_for_three_splits() -> None:
    with pytest.raises(PaveTwinError, match="2 scenes, too few"):
        split_groups([image("a", "one", "Car"), image("b", "two", "Car")], SHARES, seed=0)


def test_the_lists_name_every_image_once(tmp_path: Path) -> None:
    (tmp_path / "Annotations").mkdir()
    write_description(tmp_path, {"complete": True})
    with pytest.raises(PaveTwinError, match="is not split yet"):
        split_names(tmp_path)
    images = town(60)
    for each in images:
        annotation_path(tmp_path, each.name).write_bytes(as_xml(each))
    for at, split in enumerate(("test", "val")):
        images.append(image(f"c{at}", "corner", split=split))
        annotation_path(tmp_path, images[-1].name).write_bytes(as_xml(images[-1]))
    found = split_dataset(tmp_path, SHARES)
    assert "images given to test (1) are in val" in (tmp_path / "ImageSets/Main/report.csv").read_text()
    names = split_names(tmp_path)
    assert sorted(name for held in names.values() for name in held) == sorted(each.name for each in images)
    groups = {each.name: each.group for each in images}
    assert all(found.splits[groups[name]] == split for split, held in names.items() for name in held)
