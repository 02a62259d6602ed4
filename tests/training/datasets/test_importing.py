"""Import of a source: names, sizes, tiles, resumed runs and refusals."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from pavetwin.errors import PaveTwinError
from pavetwin.labels.boxes import PixelBox, moved, scaled, share_within, within
from pavetwin.labels.common_form import AnnotatedImage, Annotation, read_description, read_images
from pavetwin.training.datasets import importing
from pavetwin.training.datasets.duplicates import FEATURES, signature
from pavetwin.training.datasets.importing import ImportSummary, import_source
from pavetwin.training.datasets.resizing import CUT, LEAST_SHARE, ImageSize, ImageView, seen_through, views
from pavetwin.training.datasets.sources import source_of
from scenes.folders import digests
from scenes.photographs import picture, yolo

FITS, LARGE = 3, 2


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    """Five pictures, two of which are larger than 640 pixels, and one that is damaged."""
    folder = tmp_path / "photos"
    for number in range(FITS + LARGE):
        picture(folder / f"{number}.jpg", (64, 48) if number < FITS else (1000, 500), number)
        yolo(folder / f"{number}.txt", "0 0.5 0.5 0.5 0.5")
    whole = picture(folder / "bad.jpg", (700, 500), 99)
    whole.write_bytes(whole.read_bytes()[:-700])
    yolo(folder / "bad.txt", "0 0.5 0.5 0.5 0.5")
    return folder


def run(folder: Path, output: Path, **size: object) -> ImportSummary:
    name, source = source_of("highrpd")
    return import_source(name, source, folder, output, size=ImageSize.model_validate(size))


def test_pictures_that_fit_are_copied_and_others_scaled(photos: Path, tmp_path: Path) -> None:
    summary = run(photos, tmp_path / "out")
    images = list(read_images(tmp_path / "out"))
    assert summary.images == len(images) == FITS + LARGE
    assert (tmp_path / "out/JPEGImages/highrpd-0.jpg").read_bytes() == (photos / "0.jpg").read_bytes()
    large = images[-1]
    assert (large.size_px, large.labelled[0].box) == ((640, 320), (160, 80, 480, 240))
    with Image.open(tmp_path / "out" / "JPEGImages" / large.picture) as stored:
        assert stored.size == (640, 320)


def test_twice_gives_the_same_bytes_and_so_does_an_import_that_was_stopped(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(photos, tmp_path / "whole")
    run(photos, tmp_path / "again")
    whole = digests(tmp_path / "whole")
    assert digests(tmp_path / "again") == whole
    assert len(whole) == 2 * (FITS + LARGE) + 2
    moved: list[Path] = []
    move_in = importing.move_in

    def stop(staging: Path, target: Path, data: bytes) -> None:
        if len(moved) == 5:
            raise KeyboardInterrupt
        moved.append(target)
        move_in(staging, target, data)

    monkeypatch.setattr(importing, "move_in", stop)
    with pytest.raises(KeyboardInterrupt):
        run(photos, tmp_path / "stopped")
    assert read_description(tmp_path / "stopped")["complete"] is False
    moved.clear()
    made: list[Path] = []
    monkeypatch.setattr(
        importing, "move_in", lambda staging, target, data: (made.append(target), move_in(staging, target, data))
    )
    run(photos, tmp_path / "stopped")
    assert digests(tmp_path / "stopped") == whole
    # Two images were finished, and of a third only the picture was there.
    assert len(made) == 2 * (FITS + LARGE - 2)


def test_another_import_into_the_same_folder_is_refused(photos: Path, tmp_path: Path) -> None:
    run(photos, tmp_path / "out")
    with pytest.raises(PaveTwinError, match="made with another settings"):
        run(photos, tmp_path / "out", longest_px=320)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("dear")
    with pytest.raises(PaveTwinError, match="holds something else"):
        run(photos, tmp_path / "mine")


@pytest.mark.parametrize("change", ["a label", "a picture", "a picture of as many bytes", "no picture"])
def test_input_that_changed_is_not_taken_for_what_was_imported(photos: Path, tmp_path: Path, change: str) -> None:
    mine = tmp_path / "mine"
    shutil.copytree(photos, mine, copy_function=shutil.copy)
    run(photos, tmp_path / "out")
    run(mine, tmp_path / "out")
    if change == "a label":
        label = next(path for path in sorted(mine.rglob("*.txt")) if path.read_text())
        label.write_text(label.read_text().replace("0.5", "0.4"))
    elif change == "a picture of as many bytes":
        shown = next(path for path in sorted(mine.rglob("*.jpg")))
        shown.write_bytes(shown.read_bytes()[:-1] + b"\0")
    else:
        shown = next(path for path in sorted(mine.rglob("*.jpg")))
        shown.unlink()
        if change == "a picture":
            picture(shown, (300, 200), seed=99)
    with pytest.raises(PaveTwinError, match="made with another input; choose another folder"):
        run(mine, tmp_path / "out")


def test_names_are_kept_apart_by_folders_where_they_must_be(tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    for number, place in enumerate(("train/images/1", "val/images/1", "val/images/2")):
        picture(folder / f"{place}.jpg", seed=number)
        yolo(folder / f"{place.replace('images', 'labels')}.txt", "0 0.5 0.5 0.5 0.5")
    run(folder, tmp_path / "out")
    assert [image.name for image in read_images(tmp_path / "out")] == [
        "highrpd-2",
        "highrpd-train-images-1",
        "highrpd-val-images-1",
    ]


def test_names_without_latin_letters_and_long_ones_are_kept_apart(tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    stems = ("道路", "坑洞", "Straße", "strasse", "a (1)", "a 1", 200 * "x")
    for number, stem in enumerate(stems):
        picture(folder / f"{stem}.JPG", seed=number)
        yolo(folder / f"{stem}.TXT", "0 0.5 0.5 0.5 0.5")
    picture(folder / "e\N{COMBINING ACUTE ACCENT}.jpg", seed=9)
    yolo(folder / "\N{LATIN SMALL LETTER E WITH ACUTE}.txt", "0 0.5 0.5 0.5 0.5")
    assert not list(run(folder, tmp_path / "out").report)
    images = list(read_images(tmp_path / "out"))
    assert len({image.original for image in images}) == len({image.name for image in images}) == len(stems) + 1
    assert max(len(image.name) for image in images) < 120
    assert all(image.name.isascii() for image in images)
    run(folder, tmp_path / "out")
    assert len(list(read_images(tmp_path / "out"))) == len(stems) + 1


def test_pictures_of_16_bits_keep_their_greys(tmp_path: Path) -> None:
    """Of a camera with 12 bits too; what cannot be brought to 8 bits is refused."""
    folder = tmp_path / "photos"
    grey = np.asarray(Image.linear_gradient("L"))
    made = {"16": grey.astype(np.uint16) * 257, "12": grey.astype(np.uint16) * 16, "f": grey / np.float32(255)}
    for name, values in made.items():
        folder.mkdir(exist_ok=True)
        Image.fromarray(values).save(folder / f"{name}.tif")
        yolo(folder / f"{name}.txt", "0 0.5 0.5 0.5 0.5")
    Image.fromarray(grey).convert("CMYK").save(folder / "cmyk.jpg", quality=95)
    yolo(folder / "cmyk.txt", "0 0.5 0.5 0.5 0.5")
    assert [str(each) for each in run(folder, tmp_path / "out").report] == [
        "f.tif: the picture's pixels are not whole numbers; store it with 8 or 16 bits; the image is left out"
    ]
    for image in read_images(tmp_path / "out"):
        with Image.open(tmp_path / "out" / "JPEGImages" / image.picture) as stored:
            assert np.abs(np.asarray(stored.convert("L"), dtype=float) - grey).mean() < 3, image.name


def image_of(size_px: tuple[int, int], *annotations: Annotation, gsd_mm: float | None = None) -> AnnotatedImage:
    return AnnotatedImage("a", ".jpg", size_px, "uapd", "a", "a", gsd_mm, annotations=annotations)


def test_tiles_cover_the_picture_and_overlap() -> None:
    found = views(image_of((1280, 960)), ImageSize(tiles=True, tile_overlap=0.2))
    assert [view.window for view in found] == [
        (left, top, left + 640, top + 640) for top in (0, 320) for left in (0, 320, 640)
    ]
    assert {view.size_px for view in found} == {(640, 640)}


def test_what_a_tile_cuts_short_is_ignored_in_it() -> None:
    crack = Annotation("Single Crack", (600, 10, 700, 20), outline=((600.0, 10.0), (700.0, 10.0), (700.0, 20.0)))
    left = seen_through(image_of((1280, 640), crack), ImageView((0, 0, 640, 640), (640, 640), 0), ".jpg")
    (shown,) = left.annotations
    assert (shown.box, shown.ignored) == ((600, 10, 640, 20), None)
    assert shown.outline is not None
    assert max(x for x, _ in shown.outline) == 640
    right = seen_through(image_of((1280, 640), crack), ImageView((680, 0, 1280, 640), (600, 640), 1), ".jpg")
    assert [(each.box, each.ignored) for each in right.annotations] == [((0, 10, 20, 20), CUT)]
    assert (
        seen_through(image_of((1280, 640), crack), ImageView((700, 0, 1280, 640), (580, 640), 2), "").annotations == ()
    )


def test_a_target_resolution_scales_down_and_never_up() -> None:
    (finer,) = views(image_of((600, 400), gsd_mm=2.0), ImageSize(target_gsd_mm=4.0))
    assert finer.size_px == (300, 200)
    assert seen_through(image_of((600, 400), gsd_mm=2.0), finer, ".jpg").gsd_mm == 4.0
    (coarser,) = views(image_of((600, 400), gsd_mm=8.0), ImageSize(target_gsd_mm=4.0))
    assert coarser.size_px == (600, 400)
    (unknown,) = views(image_of((600, 400)), ImageSize(target_gsd_mm=4.0))
    assert unknown.size_px == (600, 400)


def test_tiles_without_a_label_are_left_out_and_told(tmp_path: Path) -> None:
    picture(tmp_path / "photos" / "wide.jpg", (1280, 640))
    yolo(tmp_path / "photos" / "wide.txt", "0 0.1 0.5 0.05 0.1")
    summary = run(tmp_path / "photos", tmp_path / "out", tiles=True)
    assert summary.images == 1
    (told,) = summary.report
    assert told.text == "2 of its 3 tiles show no label and are left out"


def test_tiles_of_one_picture_are_images_of_their_own(tmp_path: Path) -> None:
    picture(tmp_path / "photos" / "1.jpg", (1000, 640))
    yolo(tmp_path / "photos" / "1.txt", "0 0.1 0.5 0.1 0.1", "1 0.9 0.5 0.1 0.1")
    run(tmp_path / "photos", tmp_path / "out", tiles=True)
    first, last = read_images(tmp_path / "out")
    assert [each.labelled[0].category for each in (first, last)] == ["Single Crack", "Crocodile Crack"]
    assert (first.name, last.name, first.group) == ("highrpd-1-000", "highrpd-1-001", last.group)
    assert last.labelled[0].box == (490, 288, 590, 352)


MANY = """
import re, sys
from pathlib import Path
from pavetwin.labels.common_form import class_names
from pavetwin.training.datasets.exporting import export
from pavetwin.training.datasets.duplicates import signature
from pavetwin.training.datasets.importing import import_source
from pavetwin.training.datasets.merging import merge
from pavetwin.training.datasets.resizing import ImageSize
from pavetwin.training.datasets.sources import source_of
from pavetwin.training.datasets.splitting import split_dataset
folder, output = map(Path, sys.argv[1:])
made = import_source(*source_of("highrpd"), folder, output / "one", size=ImageSize())
merged = merge([made.folder], output / "all")
split_dataset(merged.folder, (0.7, 0.2, 0.1))
export(merged.folder, output / "exported", ("yolo", "coco"))
rules = "".join(f"  {name}: {name}\\n" for name in class_names())
(output / "again.yaml").write_text("labels: {format: coco}\\nclasses:\\n" + rules)
again = import_source(*source_of(str(output / "again.yaml")), output / "exported", output / "again", size=ImageSize())
assert again.images == merged.images == made.images, (again.images, merged.images, made.images)
# Of this program alone: getrusage counts what the process that started it held.
(peak_kib,) = re.findall(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())
print(made.images, peak_kib)
"""


def grained(path: Path, size: tuple[int, int], seed: int) -> Path:
    """A picture like no other, with nearly as many corners as a merge compares: then it holds the most of each."""
    width, height = size
    grain = np.random.default_rng(seed).integers(0, 256, (height // 4, width // 4), dtype=np.uint8)
    Image.fromarray(grain).resize(size).save(path, quality=60)
    return path


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the peak of a process's memory is read from /proc")
@pytest.mark.parametrize(("count", "size", "most_mib"), [(20_000, (256, 192), 1024), (1_000, (640, 480), 768)])
def test_memory_is_bounded_for_many_pictures_and_for_large_ones(
    tmp_path: Path, count: int, size: tuple[int, int], most_mib: int
) -> None:
    folder = tmp_path / "photos"
    folder.mkdir()
    for number in range(count):
        grained(folder / f"{number}.jpg", size, number)
        (folder / f"{number}.txt").write_text("0 0.5 0.5 0.5 0.5\n1 0.2 0.2 0.2 0.2\n")
    corners = [len(signature(folder / f"{number}.jpg").features.places) for number in range(20)]
    assert min(corners) >= 0.8 * FEATURES
    done = subprocess.run(
        [sys.executable, "-c", MANY, folder, tmp_path / "out"], capture_output=True, text=True, check=True
    )
    images, peak_kib = map(int, done.stdout.split())
    assert images == count
    assert peak_kib < most_mib * 1024


SIDE = st.integers(20, 900)


@st.composite
def annotations(draw: st.DrawFn, size_px: tuple[int, int]) -> Annotation:
    """A label or an ignored region, half of them with an outline that fills its box: four corners, one on each edge."""
    width, height = size_px
    left, top = draw(st.integers(0, width - 2)), draw(st.integers(0, height - 2))
    right, bottom = draw(st.integers(left + 2, width)), draw(st.integers(top + 2, height))
    outline = None
    if draw(st.booleans()):
        x, y = (draw(st.integers(low, high)) for low, high in ((left, right), (top, bottom)))
        corners = ((x, top), (right, y), (left + right - x, bottom), (left, top + bottom - y))
        outline = tuple((float(column), float(row)) for column, row in corners)
        if shapely.Polygon(outline).area < 1:
            outline = None
    ignored = draw(st.sampled_from([None, None, "hidden"]))
    return Annotation("Pothole", (left, top, right, bottom), ignored=ignored, outline=outline)


@st.composite
def images(draw: st.DrawFn) -> AnnotatedImage:
    size_px = (draw(SIDE), draw(SIDE))
    held = tuple(draw(annotations(size_px)) for _ in range(draw(st.integers(1, 4))))
    return AnnotatedImage("i", ".jpg", size_px, "uapd", "i.jpg", "i", 2.0, annotations=held)


@st.composite
def sizes(draw: st.DrawFn, tiles: bool | None = None) -> ImageSize:
    return ImageSize(
        longest_px=draw(st.integers(64, 400)),
        tiles=draw(st.booleans()) if tiles is None else tiles,
        tile_overlap=draw(st.floats(0.0, 0.5)),
        target_gsd_mm=draw(st.sampled_from([None, 2.0, 3.7])),
    )


def shown(image: AnnotatedImage, size: ImageSize) -> list[tuple[ImageView, AnnotatedImage]]:
    return [(view, seen_through(image, view, ".jpg")) for view in views(image, size)]


def back(box: PixelBox, view: ImageView) -> tuple[float, float, float, float]:
    """A box of a view in the picture's own pixels."""
    across, down = view.factors
    return moved(scaled(box, 1 / across, 1 / down), *view.window[:2])


@given(images(), sizes())
def test_views_cover_the_whole_picture_and_nothing_beyond_it(image: AnnotatedImage, size: ImageSize) -> None:
    windows = [view.window for view in views(image, size)]
    whole = shapely.box(0, 0, *image.size_px)
    assert shapely.union_all([shapely.box(*window) for window in windows]).equals(whole)
    for view in views(image, size):
        assert max(view.size_px) <= max(size.longest_px, 1)
        assert max(view.factors) <= 1.0 + 0.5 / min(view.window[2] - view.window[0], view.window[3] - view.window[1])


@given(images(), sizes())
def test_nothing_leaves_its_view_and_ignored_stays_ignored(image: AnnotatedImage, size: ImageSize) -> None:
    for view, seen in shown(image, size):
        frame = shapely.box(0, 0, *seen.size_px).buffer(0.01)
        touched = [each for each in image.annotations if within(each.box, view.window) is not None]
        assert len(seen.annotations) == len(touched)
        for before, after in zip(touched, seen.annotations, strict=True):  # AnnotatedImage checks the boxes itself
            if after.outline is not None:
                assert frame.contains(shapely.Polygon(after.outline))
                # An outline stays in its box, but for the rounding of the box to whole pixels.
                assert shapely.box(*after.box).buffer(1.01).contains(shapely.Polygon(after.outline))
            is_cut = share_within(before.box, view.window) < LEAST_SHARE
            assert after.ignored == (before.ignored or (CUT if is_cut else None))


@given(images(), sizes())
def test_boxes_come_back_from_where_they_are_seen(image: AnnotatedImage, size: ImageSize) -> None:
    for view, seen in shown(image, size):
        touched = [each for each in image.annotations if within(each.box, view.window) is not None]
        for before, after in zip(touched, seen.annotations, strict=True):
            inside = within(before.box, view.window)
            assert inside is not None
            # A pixel of the view, which is where edges are rounded to.
            for edge, exact, factor in zip(back(after.box, view), inside, view.factors * 2, strict=True):
                assert abs(edge - exact) <= 1.0 / factor + 1e-6


@given(images(), sizes(tiles=False))
def test_a_scaled_picture_keeps_its_ground_resolution_in_step(image: AnnotatedImage, size: ImageSize) -> None:
    ((_, seen),) = shown(image, size)
    assert image.gsd_mm is not None
    assert seen.gsd_mm == pytest.approx(image.gsd_mm * image.size_px[0] / seen.size_px[0], rel=1e-4)
    if size.target_gsd_mm is not None and max(seen.size_px) < size.longest_px:
        wanted = max(size.target_gsd_mm, image.gsd_mm)
        assert seen.gsd_mm == pytest.approx(wanted, rel=1.0 / min(seen.size_px))
