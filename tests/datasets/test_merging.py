"""Datasets merged: the same photograph once, one place one scene."""

import shutil
from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pavetwin.datasets.common_form import read_images
from pavetwin.datasets.duplicates import alike, thumbnail
from pavetwin.datasets.importing import import_source
from pavetwin.datasets.merging import merge
from pavetwin.datasets.normalise import ImageSize
from pavetwin.datasets.sources import source_of
from pavetwin.errors import PaveTwinError
from scenes.photographs import picture, voc, yolo


def made(source: str, folder: Path) -> Path:
    """A folder's dataset."""
    name, found = source_of(source)
    output = folder.parent / f"{folder.name}-set"
    import_source(name, found, folder, output, size=ImageSize())
    return output


@pytest.fixture
def two(tmp_path: Path) -> tuple[Path, Path]:
    """Three pictures of one source, and of another one: the second of them compressed again, and one of its own."""
    first, second = tmp_path / "one", tmp_path / "two"
    for number in range(3):
        picture(first / f"{number}.jpg", (200, 200), number)
        yolo(first / f"{number}.txt", "0 0.5 0.5 0.5 0.5")
    with Image.open(first / "1.jpg") as again:
        second.mkdir()
        again.resize((150, 150)).save(second / "again.jpg", quality=60)
    picture(second / "other.jpg", (150, 150), 9)
    for name in ("again", "other"):
        voc(second / f"{name}.xml", [("PH", (1, 1, 50, 50))], (150, 150))
    return made("highrpd", first), made("uapd", second)


def names(folder: Path) -> list[str]:
    return [image.name for image in read_images(folder)]


def test_a_picture_of_two_sources_is_kept_once_by_the_order_given(two: tuple[Path, Path], tmp_path: Path) -> None:
    summary = merge(two, tmp_path / "all")
    assert names(tmp_path / "all") == ["highrpd-0", "highrpd-1", "highrpd-2", "uapd-other"]
    assert [str(each) for each in summary.report] == ["two-set/uapd-again: the same picture as one-set/highrpd-1"]
    merge(two[::-1], tmp_path / "reversed")
    assert names(tmp_path / "reversed") == ["highrpd-0", "highrpd-2", "uapd-again", "uapd-other"]


def test_a_merge_that_is_repeated_gives_the_same_bytes(two: tuple[Path, Path], tmp_path: Path) -> None:
    for name in ("first", "second", "second"):
        merge(two, tmp_path / name)
        (tmp_path / "second" / "Annotations" / "highrpd-1.xml").unlink(missing_ok=True)
    merge(two, tmp_path / "second")
    files = [path.relative_to(tmp_path / "first") for path in (tmp_path / "first").rglob("*") if path.is_file()]
    assert len(files) == 4 * 2 + 2
    for path in files:
        assert (tmp_path / "first" / path).read_bytes() == (tmp_path / "second" / path).read_bytes(), path


def test_pictures_of_one_place_are_one_scene(tmp_path: Path) -> None:
    folder = tmp_path / "one"
    wide = picture(tmp_path / "wide.png", (220, 210), 5)
    for number, left in enumerate((0, 5, 10)):
        with Image.open(wide) as whole:
            folder.mkdir(exist_ok=True)
            whole.crop((left, 0, left + 200, 200)).save(folder / f"{number}.jpg")
    picture(folder / "3.jpg", (200, 200), 6)
    for number in range(4):
        yolo(folder / f"{number}.txt", "0 0.5 0.5 0.5 0.5")
    summary = merge([made("highrpd", folder)], tmp_path / "all")
    first, second, third, other = (image.group for image in read_images(tmp_path / "all"))
    assert first == second == third != other
    assert "one-set/highrpd-1: shows the same place as one-set/highrpd-0; their scenes are one" in map(
        str, summary.report
    )


def test_uapd_and_the_china_drone_subset_share_pictures(shared_file: Callable[[str], Path], tmp_path: Path) -> None:
    china, uapd = tmp_path / "china", tmp_path / "uapd"
    for folder in (china, uapd):
        folder.mkdir()
    shared = {"Alligator crack": 616, "Repair1": 42}
    for number in (1, *shared.values()):
        part = "real/rdd2022_china_drone/China_Drone/train"
        shutil.copyfile(shared_file(f"{part}/images/China_Drone_{number:06d}.jpg"), china / f"{number}.jpg")
        shutil.copyfile(shared_file(f"{part}/annotations/xmls/China_Drone_{number:06d}.xml"), china / f"{number}.xml")
    for name in (*shared, "Pothole"):
        shutil.copyfile(shared_file(f"real/uapd_samples/Sample images/{name}.JPG"), uapd / f"{name}.JPG")
        voc(uapd / f"{name}.xml", [("AC", (1, 1, 90, 90))], (512, 512))
    summary = merge([made("rdd2022-china-drone", china), made("uapd", uapd)], tmp_path / "all")
    dropped = {each.file for each in summary.report if "the same picture" in each.text}
    there = {image.original for image in read_images(tmp_path / "china-set")}
    # An image of the subset that has no box of ours was left out before.
    assert dropped == {
        f"uapd-set/uapd-{name.replace(' ', '-')}" for name, number in shared.items() if f"{number}.jpg" in there
    }
    assert dropped


def noise(seed: int, bar: int = 0) -> bytes:
    grey = np.random.default_rng(seed).integers(60, 200, (16, 16), dtype=np.uint8)
    pixels = np.asarray(Image.fromarray(grey).resize((256, 256), Image.Resampling.BICUBIC)).copy()
    pixels[256 - bar :] = 0
    held = BytesIO()
    Image.fromarray(pixels).save(held, "JPEG", quality=90)
    return held.getvalue()


def test_black_bars_and_flat_pictures_are_like_nothing() -> None:
    barred = np.array([thumbnail(noise(seed, 24)) for seed in range(8)])
    assert list(alike(barred, 0.6)) == []
    held = BytesIO()
    Image.new("RGB", (64, 64), (90, 90, 90)).save(held, "JPEG")
    flat = thumbnail(held.getvalue())
    assert not flat.any()
    assert list(alike(np.array([flat, flat]))) == []
    (pair,) = alike(np.array([thumbnail(noise(1)), thumbnail(noise(1, 24))]), 0.8)
    assert pair[:2] == (0, 1)


def test_all_pairs_are_found_whatever_the_size_of_the_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = np.array([thumbnail(noise(seed % 5)) for seed in range(17)])
    whole = [pair[:2] for pair in alike(rows)]
    assert sorted(whole) == sorted((a, b) for a in range(17) for b in range(a + 1, 17) if a % 5 == b % 5)
    monkeypatch.setattr("pavetwin.datasets.duplicates.BLOCK", 4)
    assert sorted(pair[:2] for pair in alike(rows)) == sorted(whole)


def test_an_unfinished_dataset_and_the_output_itself_are_refused(two: tuple[Path, Path], tmp_path: Path) -> None:
    with pytest.raises(PaveTwinError, match="must be different folders"):
        merge([two[0], two[0]], tmp_path / "all")
    description = two[0] / "dataset.yaml"
    description.write_text(description.read_text().replace("complete: true", "complete: false"))
    with pytest.raises(PaveTwinError, match="is not finished"):
        merge(two, tmp_path / "all")
    assert not (tmp_path / "all").exists()
