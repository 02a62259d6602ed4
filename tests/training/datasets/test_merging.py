"""Datasets merged: the same photograph once, one place one scene."""

import shutil
from collections import defaultdict
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from PIL import Image

from pavetwin.errors import PaveTwinError
from pavetwin.labels.common_form import (
    AnnotatedImage,
    Annotation,
    annotation_path,
    as_xml,
    read_images,
    write_description,
)
from pavetwin.training.datasets import duplicates as overlaps
from pavetwin.training.datasets import merging
from pavetwin.training.datasets.duplicates import alike, read_grey, signature, thumbnail
from pavetwin.training.datasets.importing import import_source
from pavetwin.training.datasets.merging import merge
from pavetwin.training.datasets.resizing import ImageSize
from pavetwin.training.datasets.sources import source_of
from pavetwin.training.datasets.splitting import split_groups
from scenes.photographs import picture, voc, yolo

BOX = (1, 1, 50, 50)


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


def test_a_finished_merge_is_not_made_again_and_tells_the_same(
    two: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = merge(two, tmp_path / "all")
    compared: list[Path] = []
    monkeypatch.setattr(merging, "signature", lambda path: (compared.append(path), signature(path))[1])
    again = merge(two, tmp_path / "all")
    assert compared == []
    assert (again.images, again.report.counts) == (first.images, first.report.counts)
    assert list(map(str, again.report)) == list(map(str, first.report))
    (tmp_path / "all" / "Annotations" / "uapd-other.xml").unlink()
    assert merge(two, tmp_path / "all").images == first.images
    assert len(compared) == 5
    (tmp_path / "all" / "report.csv").unlink()
    merge(two, tmp_path / "all")
    assert (tmp_path / "all" / "report.csv").is_file()


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


FORMS = ("itself", "compressed again", "shifted")


def variant(place: int, form: str) -> bytes:
    """A picture of a place: the same bytes, the same photograph, or a neighbouring frame."""
    grey = np.random.default_rng(place).integers(40, 216, (16, 16), dtype=np.uint8)
    whole = Image.fromarray(grey).resize((136, 136), Image.Resampling.BICUBIC)
    left = 2 if form == "shifted" else 0
    held = BytesIO()
    whole.crop((left, 0, left + 128, 128)).save(held, "JPEG", quality=70 if form == "compressed again" else 90)
    return held.getvalue()


@given(
    st.lists(
        st.tuples(st.booleans(), st.integers(0, 5), st.integers(0, 4), st.sampled_from(FORMS)), min_size=2, max_size=9
    )
)
@example([(False, 0, 0, "itself"), (False, 1, 1, "itself"), (True, 0, 2, "itself"), (True, 2, 2, "itself")])
@example([(False, 0, 0, "itself"), (True, 0, 2, "compressed again"), (True, 2, 2, "itself")])
@settings(max_examples=10, deadline=None)
def test_what_places_or_scenes_connect_is_in_one_split(pictures: list[tuple[bool, int, int, str]]) -> None:
    """Pictures connect their scenes, also those that are dropped as the same: flights whose pictures are in two
    datasets are one."""
    with TemporaryDirectory() as folder:
        datasets = [Path(folder) / each for each in ("one", "two")]
        for dataset in datasets:
            (dataset / "Annotations").mkdir(parents=True)
            (dataset / "JPEGImages").mkdir()
            write_description(dataset, {"complete": True, "name": dataset.name})
        above: dict[object, object] = {}

        def of(node: object) -> object:
            return of(above[node]) if node in above else node

        for number, (is_second, place, flight, form) in enumerate(pictures):
            scene, name = f"{int(is_second)}:{flight}", f"i{number}"
            image = AnnotatedImage(name, ".jpg", (128, 128), "s", name, scene, annotations=(Annotation("Car", BOX),))
            (datasets[is_second] / "JPEGImages" / image.picture).write_bytes(variant(place, form))
            annotation_path(datasets[is_second], name).write_bytes(as_xml(image))
            if of(place) != of(scene):
                above[of(scene)] = of(place)
        merged = merge(datasets, Path(folder) / "all").folder
        splits = split_groups(read_images(merged), (1.0, 0.0, 0.0), seed=0).splits
        connected: dict[object, set[str]] = defaultdict(set)
        for image in read_images(merged):
            connected[of(pictures[int(image.name[1:])][1])].add(image.group)
        assert all(len(groups) == 1 for groups in connected.values())
        assert len(splits) == len(connected)


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
    barred = np.array([thumbnail(read_grey(noise(seed, 24))) for seed in range(8)])
    assert list(alike(barred, 0.6)) == []
    held = BytesIO()
    Image.new("RGB", (64, 64), (90, 90, 90)).save(held, "JPEG")
    flat = thumbnail(read_grey(held.getvalue()))
    assert not flat.any()
    assert list(alike(np.array([flat, flat]))) == []
    (pair,) = alike(np.array([thumbnail(read_grey(noise(1))), thumbnail(read_grey(noise(1, 24)))]), 0.8)
    assert pair[:2] == (0, 1)


def test_all_pairs_are_found_whatever_the_size_of_the_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = np.array([thumbnail(read_grey(noise(seed % 5))) for seed in range(17)])
    whole = [pair[:2] for pair in alike(rows)]
    assert sorted(whole) == sorted((a, b) for a in range(17) for b in range(a + 1, 17) if a % 5 == b % 5)
    monkeypatch.setattr("pavetwin.training.datasets.duplicates.BLOCK", 4)
    assert sorted(pair[:2] for pair in alike(rows)) == sorted(whole)


def test_an_unfinished_dataset_and_the_output_itself_are_refused(two: tuple[Path, Path], tmp_path: Path) -> None:
    with pytest.raises(PaveTwinError, match="must be different folders"):
        merge([two[0], two[0]], tmp_path / "all")
    description = two[0] / "dataset.yaml"
    description.write_text(description.read_text().replace("complete: true", "complete: false"))
    with pytest.raises(PaveTwinError, match="is not finished"):
        merge(two, tmp_path / "all")
    assert not (tmp_path / "all").exists()


# --- Overlaps --------------------------------------------------------------------------------------------------------


def street(seed: int) -> Image.Image:
    """A place with coarse and fine detail, as weathered asphalt has, 900 × 700."""
    rng = np.random.default_rng(seed)
    grey = np.full((700, 900), 120.0)
    for columns, rows in ((18, 14), (45, 35), (90, 70)):
        grain = Image.fromarray(rng.normal(0.0, 18.0, (rows, columns)).astype(np.float32))
        grey += np.asarray(grain.resize((900, 700), Image.Resampling.BICUBIC))
    return Image.fromarray(np.clip(grey, 0, 255).astype(np.uint8))


def seen(place: Image.Image, box: tuple[int, int, int, int], scale: float = 1.0, turn_deg: float = 0.0) -> Image.Image:
    part = place.rotate(turn_deg, Image.Resampling.BICUBIC, center=((box[0] + box[2]) / 2, (box[1] + box[3]) / 2))
    return part.crop(box).resize((round(scale * (box[2] - box[0])), round(scale * (box[3] - box[1]))))


def described(picture: Image.Image, quality: int = 90) -> overlaps.Features:
    held = BytesIO()
    picture.save(held, "JPEG", quality=quality)
    return overlaps.features(np.asarray(read_grey(held.getvalue())))


@pytest.mark.parametrize(
    ("box", "scale", "turn_deg"),
    [
        ((250, 100, 750, 600), 1.0, 0.0),  # half of the first
        ((150, 100, 530, 480), 0.8, 0.0),  # cut out of it
        ((60, 60, 560, 560), 0.9, 7.0),
    ],
)
def test_a_picture_that_overlaps_another_is_found(
    box: tuple[int, int, int, int], scale: float, turn_deg: float
) -> None:
    first = seen(street(1), (50, 50, 550, 550))
    other = seen(street(1), box, scale, turn_deg)
    pictures = [described(first), described(street(2)), described(other, quality=60)]
    found = list(overlaps.candidates(pictures))
    assert (0, 2) in found
    assert [pair for pair in found if overlaps.overlap(*(pictures[at] for at in pair))] == [(0, 2)]
    size = (32, 32)
    same = [thumbnail(each.resize(size)) for each in (first, other)]
    assert list(alike(np.array(same))) == []  # what small pictures alone do not find


def test_pictures_without_corners_overlap_nothing() -> None:
    flat = overlaps.features(np.full((300, 400), 90, dtype=np.uint8))
    assert len(flat.places) == len(flat.patterns) == 0
    assert list(overlaps.candidates([flat, flat])) == []
    assert not overlaps.overlap(flat, flat)
    assert list(overlaps.candidates([])) == []


def test_what_overlaps_is_one_scene_after_a_merge(tmp_path: Path) -> None:
    folder = tmp_path / "one"
    folder.mkdir()
    for number, left in enumerate((0, 220, 400)):  # the first and the third share 80 of 480 columns
        seen(street(3), (left, 0, left + 480, 480)).save(folder / f"{number}.jpg")
    street(4).crop((0, 0, 480, 480)).save(folder / "3.jpg")
    for number in range(4):
        yolo(folder / f"{number}.txt", "0 0.5 0.5 0.5 0.5")
    summary = merge([made("highrpd", folder)], tmp_path / "all")
    first, second, third, other = (image.group for image in read_images(tmp_path / "all"))
    assert first == second == third != other
    assert [str(each) for each in summary.report] == [
        "one-set/highrpd-1: overlaps one-set/highrpd-0; their scenes are one",
        "one-set/highrpd-2: overlaps one-set/highrpd-1; their scenes are one",
    ]
