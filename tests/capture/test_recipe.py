"""Synthetic images of several worlds from one file: each world in one split, joined, resumed."""

import json
import shutil
from pathlib import Path

import pytest

from pavetwin.capture.recipe import CAPTURES, JOINED, SyntheticRecipe, SyntheticSummary, build_synthetic
from pavetwin.cli.data import _parts
from pavetwin.errors import PaveTwinError
from pavetwin.training.datasets.packs import read_examples
from pavetwin.training.datasets.recipe import RecipePack, pack
from scenes import scene_file
from scenes.folders import contents
from scenes.painter import Painter

RECIPE = """
worlds:
  west: {map: cross.osm, streets: {seed: 1}, defects: {population: paper, per_segment: 12}}
  east: {map: cross.osm, split: test, streets: {seed: 1}, defects: {population: paper, per_segment: 8}}
captures:
  air: {platforms: [uav], images: 3, altitudes_m: [5], densities: [medium], size_px: [128, 128], empty: 0.34}
seed: 4
"""


def recipe(folder: Path, text: str = RECIPE) -> SyntheticRecipe:
    shutil.copy(scene_file("cross"), folder / "cross.osm")
    (folder / "recipe.yaml").write_text(text)
    photographs, synthetic, _ = _parts(folder / "recipe.yaml")
    assert photographs is None
    assert synthetic is not None
    return synthetic


@pytest.fixture(scope="module")
def output(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("synthetic")
    build(folder, recipe(folder))
    return folder / "out"


def build(folder: Path, synthetic: SyntheticRecipe) -> SyntheticSummary:
    return build_synthetic(synthetic, folder, folder / "out", frame_source_factory=Painter)


@pytest.mark.slow
def test_every_world_is_in_one_split(output: Path) -> None:
    captures = {}
    for split in ("train", "test"):
        content = json.loads((output / JOINED / "annotations" / f"instances_{split}.json").read_text())
        captures[split] = {image["capture"] for image in content["images"]}
        assert [image["id"] for image in content["images"]] == [0, 1, 2]
        assert {each["image_id"] for each in content["annotations"]} <= {0, 1, 2}
        assert len({each["id"] for each in content["annotations"]}) == len(content["annotations"])
    assert captures == {"train": {"west-air"}, "test": {"east-air"}}
    assert not (output / JOINED / "annotations" / "instances_val.json").exists()


@pytest.mark.slow
def test_labels_stay_with_their_images(output: Path) -> None:
    """A world's file and the joined one say the same of each picture."""
    joined = {
        each.name: (each.objects, data.encoded(each))
        for data in read_examples([output / JOINED], ("train", "test"))
        for each in data.examples
    }
    assert len(joined) == 6
    for name in ("west-air", "east-air"):
        for data in read_examples([output / "captures" / name], ("train", "test")):
            for each in data.examples:
                assert joined[each.name] == (each.objects, data.encoded(each))


@pytest.mark.slow
def test_only_what_is_missing_is_captured_again(output: Path, tmp_path: Path) -> None:
    shutil.copytree(output.parent, tmp_path, dirs_exist_ok=True)
    whole = contents(tmp_path / "out" / JOINED)
    shutil.rmtree(tmp_path / "out" / JOINED)
    shutil.rmtree(tmp_path / "out" / "captures" / "east-air")
    assert build(tmp_path, recipe(tmp_path)).taken == 3
    assert contents(tmp_path / "out" / JOINED) == whole


@pytest.mark.slow
def test_more_images_of_a_split_are_added_to_what_is_there(output: Path, tmp_path: Path) -> None:
    shutil.copytree(output.parent, tmp_path, dirs_exist_ok=True)
    before = {name: data for name, data in contents(output / JOINED).items() if name.startswith("images")}
    more = RECIPE.replace("images: 3,", "images: 3, images_of: {train: 5},")
    assert build(tmp_path, recipe(tmp_path, more)).taken == 2
    after = contents(tmp_path / "out" / JOINED)
    assert len([name for name in after if name.startswith("images")]) == len(before) + 2
    assert {name: after[name] for name in before} == before


@pytest.mark.slow
def test_a_world_of_another_recipe_is_refused(output: Path, tmp_path: Path) -> None:
    shutil.copytree(output.parent, tmp_path, dirs_exist_ok=True)
    with pytest.raises(PaveTwinError, match="east' was built otherwise than the recipe says"):
        build(tmp_path, recipe(tmp_path, RECIPE.replace("per_segment: 8", "per_segment: 9")))


@pytest.mark.slow
def test_all_splits_that_are_asked_for_are_packed(output: Path, tmp_path: Path) -> None:
    file = tmp_path / "all.pack"
    pack([output / JOINED], file, RecipePack(splits=("train", "test")))
    assert {each.split for data in read_examples([file], ("train", "test")) for each in data.examples} == {
        "train",
        "test",
    }


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("seed: 4", "seed: 4\nimages: 3", "unknown key 'images'"),
        ("{map: cross.osm, split: test,", "{split: test,", r"worlds\.east: give either generate or map"),
        ("densities: [medium]", "split: [1, 0, 0]", r"captures\.air\.split: give the `split` of each world"),
        ("split: test", "split: all", r"worlds\.east\.split"),
        ("images: 3,", "images: 3, images_of: {all: 2},", r"captures\.air\.images_of\.all"),
        ("images: 3,", "images: 3, images_of: {test: 0},", r"captures\.air\.images_of\.test"),
    ],
)
def test_what_a_recipe_cannot_say_is_refused(tmp_path: Path, before: str, after: str, message: str) -> None:
    with pytest.raises(PaveTwinError, match=message):
        recipe(tmp_path, RECIPE.replace(before, after))


def test_worlds_of_a_split_may_have_more_images(tmp_path: Path) -> None:
    """Nothing else of the capture changes, so that what is there is added to."""
    (same,) = recipe(tmp_path).captures.values()
    (more,) = recipe(tmp_path, RECIPE.replace("images: 3,", "images: 3, images_of: {train: 7},")).captures.values()
    assert more.of_world("test", 4) == same.of_world("test", 4)
    assert more.of_world("train", 4) == same.of_world("train", 4).model_copy(update={"images": 7})
    assert same.of_world("val", 4).split == (0.0, 1.0, 0.0)
    assert same.of_world("val", 4).formats == ("coco",)


def test_a_missing_map_is_refused_before_anything_is_built(tmp_path: Path) -> None:
    synthetic = recipe(tmp_path, RECIPE.replace("east: {map: cross.osm", "east: {map: gone.osm"))
    with pytest.raises(PaveTwinError, match=r"no map '.*gone\.osm'"):
        build(tmp_path, synthetic)
    assert not (tmp_path / "out").exists()


def test_a_capture_is_limited_to_some_worlds_with_a_seed_of_its_own(tmp_path: Path) -> None:
    more = "  more: {worlds: [west], seed: 7, platforms: [uav], images: 1, altitudes_m: [5], size_px: [128, 128]}\n"
    synthetic = recipe(tmp_path, RECIPE.replace("seed: 4", f"{more}seed: 4"))
    build(tmp_path, synthetic)
    assert {folder.name for folder in (tmp_path / "out" / CAPTURES).iterdir()} == {"west-air", "east-air", "west-more"}
    assert synthetic.captures["more"].of_world("train", 4).seed == 7
    assert synthetic.captures["air"].of_world("train", 4).seed == 4
    with pytest.raises(PaveTwinError, match=r"captures.more.worlds.*'wets'"):
        recipe(tmp_path, RECIPE.replace("seed: 4", f"{more.replace('west', 'wets')}seed: 4"))


@pytest.mark.parametrize(("name", "splits"), [("rendered", 3), ("frames", 1), ("maps", 1), ("photographs", 0)])
def test_the_recipes_of_the_project_are_read(name: str, splits: int) -> None:
    _, synthetic, _ = _parts(Path(__file__).parents[2] / "recipes" / f"{name}.yaml")
    assert len({world.split for world in synthetic.worlds.values()} if synthetic is not None else ()) == splits
