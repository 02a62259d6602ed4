"""A whole dataset from one file: twice the same bytes, also when it was stopped in between."""

import os
import signal
import subprocess
import time
from pathlib import Path

import pytest
from PIL import Image

from pavetwin.errors import PaveTwinError
from pavetwin.training.datasets.recipe import Recipe, build, recipe_values
from scenes.command_line import command, pavetwin
from scenes.folders import digests
from scenes.photographs import picture, voc, yolo

RECIPE = """
sources:
  - {source: uapd, folder: roads}
  - {source: mine.yaml, folder: cars, background: checked.txt, gsd_mm: 12, size: {longest_px: 160}}
size: {longest_px: 128}
split: [50, 25, 25]
export: [yolo, coco]
"""


@pytest.fixture
def recipe(tmp_path: Path) -> Path:
    """Pictures of roads and of cars, one of which is in both; one is verified background, one is damaged."""
    for number in range(12):
        picture(tmp_path / "roads" / f"{number}.jpg", (200, 100), number)
        voc(tmp_path / "roads" / f"{number}.xml", [("LC", (1, 1, 99, 9)), ("PH", (9, 9, 40, 40))], (200, 100))
        picture(tmp_path / "cars" / f"{number}.jpg", (160, 160), 100 + number if number else 0)
        yolo(tmp_path / "cars" / f"{number}.txt", *(["0 0.5 0.5 0.2 0.1"] if number != 5 else []))
    picture(tmp_path / "cars" / "0.jpg", (200, 100), 0)
    damaged = tmp_path / "cars" / "7.jpg"
    damaged.write_bytes(damaged.read_bytes()[:-500])
    (tmp_path / "checked.txt").write_text("5.jpg\n")
    (tmp_path / "mine.yaml").write_text("labels: {format: yolo, names: [car]}\nclasses: {car: Car}\n")
    (tmp_path / "recipe.yaml").write_text(RECIPE)
    return tmp_path / "recipe.yaml"


def read_recipe(path: Path) -> Recipe:
    """As the command reads it."""
    values, text = recipe_values(path)
    return Recipe.parse(values, f"the recipe '{path}'", text)


def test_a_build_makes_every_stage_and_again_the_same_bytes(recipe: Path, tmp_path: Path) -> None:
    done = pavetwin("data", "build", recipe, "-o", tmp_path / "out")
    assert done.returncode == 1, "a damaged picture was refused"
    assert "refused: 7.jpg: the picture is damaged; the image is left out" in done.stderr
    assert "dropped: mine/mine-0: the same picture as uapd/uapd-0" in done.stderr
    assert Image.open(tmp_path / "out" / "merged" / "JPEGImages" / "mine-1.jpg").size == (160, 160)
    assert Image.open(tmp_path / "out" / "merged" / "JPEGImages" / "uapd-1.jpg").size == (128, 64)
    rows = [line.split() for line in done.stdout.splitlines()]
    assert ["mine", "0", "0", "0", "0", "9", "0", "9", "1", "10", "10"] in rows
    assert "22 images as yolo, 22 images as coco" in done.stdout
    found = build(read_recipe(recipe), tmp_path, tmp_path / "again")
    assert found.exported == {"yolo": 22, "coco": 22}
    assert digests(tmp_path / "again") == digests(tmp_path / "out")
    build(read_recipe(recipe), tmp_path, tmp_path / "again")
    assert digests(tmp_path / "again") == digests(tmp_path / "out")
    recipe.write_text(RECIPE + "seed: 1\n")
    with pytest.raises(PaveTwinError, match="made with another seed; choose another folder"):
        build(read_recipe(recipe), tmp_path, tmp_path / "again")
    assert digests(tmp_path / "again") == digests(tmp_path / "out")


@pytest.mark.slow
def test_a_build_that_is_killed_goes_on_to_the_same_bytes(recipe: Path, tmp_path: Path) -> None:
    build(read_recipe(recipe), tmp_path, tmp_path / "whole")
    whole = digests(tmp_path / "whole")
    seen = 0
    for wanted in ("imports/uapd/Annotations/*.xml", "imports/mine/Annotations/*.xml", "merged/Annotations/*.xml"):
        started = subprocess.Popen(
            command("data", "build", recipe, "-o", tmp_path / "killed"), stderr=subprocess.DEVNULL
        )
        while started.poll() is None and not list((tmp_path / "killed").glob(wanted)):
            time.sleep(0.001)
        if started.poll() is None:
            os.kill(started.pid, signal.SIGKILL)
            seen += 1
        started.wait()
    assert seen >= 2
    build(read_recipe(recipe), tmp_path, tmp_path / "killed")
    assert digests(tmp_path / "killed") == whole


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("export: [yolo, coco]", "export: [yolo, cocoo]", "export: no format 'cocoo' (did you mean 'coco'?)"),
        ("split:", "spilt:", "unknown key 'spilt' (did you mean 'split'?)"),
        ("source: uapd", "source: uadp", "no dataset source 'uadp' (did you mean 'uapd'?)"),
        ("folder: cars", "folder: cats", "There is no folder"),
        ("[50, 25, 25]", "[50, 25]", "split"),
        ("[50, 25, 25]", "[50, 25, 30]", "line 6: split: train, val and test must sum to 100 percent"),
        ("[50, 25, 25]", "[110, -20, 10]", "none below 0"),
        ("split:", "splitt:", "line 6: unknown key 'splitt'"),
        ("gsd_mm: 12,", "gsd_mm: -1,", "line 4: sources.2.gsd_mm: "),
        ("checked.txt", "chekced.txt", "chekced.txt' cannot be read as a list of pictures"),
        (
            "size: {longest_px: 128}",
            "composite:\n  objects: [mine]\n  roads: [uapd, uadp]",
            "line 7: composite.roads: no source of this recipe 'uadp' (did you mean 'uapd'?); known are uapd, mine.",
        ),
        (
            "size: {longest_px: 128}",
            "composite: {objects: [mien], roads: [uapd]}",
            "line 5: composite.objects: no source of this recipe 'mien' (did you mean 'mine'?)",
        ),
        (
            "size: {longest_px: 128}",
            "composite: {objects: [mine], roads: [uapd], road_masks: gone}",
            "road_masks`: there is no folder",
        ),
    ],
)
def test_a_wrong_recipe_is_refused_plainly(recipe: Path, tmp_path: Path, old: str, new: str, words: str) -> None:
    recipe.write_text(RECIPE.replace(old, new))
    with pytest.raises(PaveTwinError) as refused:
        build(read_recipe(recipe), tmp_path, tmp_path / "out")
    assert words in str(refused.value)
    assert not list((tmp_path / "out").rglob("*.xml"))
