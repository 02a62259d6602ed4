"""Changed copies of images, and the balance of classes that they make."""

import re
from collections import Counter
from collections.abc import Callable
from math import cos, radians, sin
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image, ImageDraw

from pavetwin.labels.boxes import flipped
from pavetwin.labels.common_form import AnnotatedImage, Annotation, read_images
from pavetwin.training.datasets import augmenting, balancing
from pavetwin.training.datasets.augmenting import (
    GONE_SHARE,
    ImageChange,
    changed,
    changed_picture,
    moved_points,
    shown_window,
)
from pavetwin.training.datasets.balancing import BalanceSettings, balance, draw_change
from pavetwin.training.datasets.importing import import_source
from pavetwin.training.datasets.merging import merge
from pavetwin.training.datasets.resizing import CUT, LEAST_SHARE, ImageSize
from pavetwin.training.datasets.sources import source_of
from pavetwin.training.datasets.splitting import split_dataset, split_names
from scenes.command_line import pavetwin, plain_refusal
from scenes.folders import digests
from scenes.photographs import picture, voc

ANGLES = st.floats(-15, 15).map(lambda angle: round(angle, 1))
FLIP = ImageChange(is_flipped=True)


@st.composite
def images(draw: st.DrawFn) -> AnnotatedImage:
    """An image with up to three annotations, some of which have an outline within their box."""
    width, height = draw(st.integers(40, 700)), draw(st.integers(40, 700))

    def annotation() -> Annotation:
        left, top = draw(st.integers(0, width - 4)), draw(st.integers(0, height - 4))
        right, bottom = draw(st.integers(left + 4, width)), draw(st.integers(top + 4, height))
        shares = draw(st.none() | st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1)), min_size=3, max_size=6))
        outline = None
        if shares is not None:
            outline = tuple(
                (round(left + (right - left) * x, 2), round(top + (bottom - top) * y, 2)) for x, y in shares
            )
        ignored = draw(st.none() | st.just("class 'Block crack'"))
        return Annotation("Pothole" if ignored is None else None, (left, top, right, bottom), ignored, outline)

    annotations = tuple(annotation() for _ in range(draw(st.integers(1, 3))))
    return AnnotatedImage("a", ".jpg", (width, height), "s", "a.jpg", "s:a", gsd_mm=2.5, annotations=annotations)


def image_of(*annotations: Annotation, size: tuple[int, int] = (200, 100)) -> AnnotatedImage:
    return AnnotatedImage("a", ".jpg", size, "s", "a.jpg", "s:a", annotations=annotations)


@given(images())
def test_flipped_twice_it_is_the_image_again(image: AnnotatedImage) -> None:
    once = changed(image, FLIP, "b")
    assert changed(once, FLIP, "c").annotations == image.annotations
    left, top, right, bottom = image.annotations[0].box
    assert once.annotations[0].box == (image.size_px[0] - right, top, image.size_px[0] - left, bottom)
    assert flipped(once.annotations[0].box, image.size_px[0]) == image.annotations[0].box


@given(images(), ANGLES, st.booleans())
def test_a_box_encloses_what_is_still_shown_and_nothing_leaves_the_image(
    image: AnnotatedImage, angle: float, is_flipped: bool
) -> None:
    change = ImageChange(is_flipped, angle)
    copy = changed(image, change, "b")
    width, height = copy.size_px
    for number, each in enumerate(image.annotations):
        (found,) = changed(image_of(each, size=image.size_px), change, "b").annotations or (None,)
        if found is None:
            continue
        assert len(copy.annotations) <= len(image.annotations), number
        x, y = np.meshgrid(np.linspace(each.box[0], each.box[2], 7), np.linspace(each.box[1], each.box[3], 7))
        inner = np.column_stack([x.ravel(), y.ravel()]) if each.outline is None else np.array(each.outline)
        points = moved_points(inner, image.size_px, change)
        points = points[((points >= 0) & (points <= (width, height))).all(axis=1)]
        left, top, right, bottom = found.box
        # Corners of outlines are kept to a hundredth of a pixel.
        assert (points >= np.array([left, top]) - 0.01).all()
        assert (points <= np.array([right, bottom]) + 0.01).all()
        if found.outline is not None:
            corners = np.array(found.outline)
            assert (corners >= -0.01).all()
            assert (corners <= np.array(copy.size_px) + 0.01).all()


@given(st.integers(8, 900), st.integers(8, 900), ANGLES)
def test_what_is_kept_of_a_rotated_image_shows_nothing_else_and_no_less(width: int, height: int, angle: float) -> None:
    left, top, right, bottom = shown_window((width, height), angle)
    assert 0 <= left < right <= width
    assert 0 <= top < bottom <= height

    def beyond(grown: float) -> float:
        """How far the corners of the window, grown on all sides, lie outside the image before it was rotated."""
        x = np.array([left - grown, right + grown] * 2) - width / 2
        y = np.repeat([top - grown, bottom + grown], 2) - height / 2
        c, s = cos(radians(angle)), sin(radians(angle))
        back = np.column_stack([c * x - s * y + width / 2, s * x + c * y + height / 2])
        return float(max((-back).max(), (back - (width, height)).max()))

    assert beyond(0.0) <= 1e-6 or min(right - left, bottom - top) <= 2
    assert beyond(1.5) > 0


def test_what_shows_too_little_is_no_label_any_more() -> None:
    """Boxes at the left border of a square that is rotated by 15°, and one in a corner that is cut off."""
    side = 400
    boxes = [(0, 195, width, 205) for width in (32, 37, 80)]
    boxes.append((0, 0, 20, 20))
    shares = []
    for width in (box[2] for box in boxes[:3]):
        corners = np.array([[x, 200.0] for x in np.linspace(0, width, 2001)])
        shares.append(float((moved_points(corners, (side, side), ImageChange(rotation_deg=15.0))[:, 0] > 0).mean()))
    assert shares[0] < GONE_SHARE < shares[1] < LEAST_SHARE < shares[2]
    for reason in (None, "hidden"):
        found = [
            changed(image_of(Annotation("Car", box, reason), size=(side, side)), ImageChange(rotation_deg=15.0), "b")
            for box in boxes
        ]
        told = [[each.ignored for each in image.annotations] for image in found]
        assert told == [[], [reason or CUT], [reason], []]


def test_a_copy_keeps_scene_and_ground_resolution_and_says_what_it_is() -> None:
    image = AnnotatedImage("a", ".png", (200, 100), "s", "a.png", "s:flight", gsd_mm=2.5, attributes={"split": "train"})
    copy = changed(image, ImageChange(True, -7.5, 0.1, -0.2, 0.01), "a-copy-01")
    assert (copy.group, copy.gsd_mm, copy.picture) == ("s:flight", 2.5, "a-copy-01.jpg")
    assert copy.attributes == {
        "split": "train",
        "copy_of": "a",
        "changes": "flipped, rotated -7.5°, brightness +0.100, contrast -0.200, noise 0.010",
    }


@pytest.mark.parametrize("change", [FLIP, ImageChange(False, 15.0), ImageChange(True, -9.5)])
def test_pictures_go_where_their_labels_go(change: ImageChange) -> None:
    outline = ((60.0, 20.0), (150.0, 35.0), (130.0, 80.0), (70.0, 60.0))
    image = image_of(Annotation("Pothole", (60, 20, 150, 80), outline=outline))
    picture = Image.new("RGB", image.size_px)
    ImageDraw.Draw(picture).polygon(outline, fill=(255, 255, 255))
    shown = changed_picture(np.asarray(picture), change)[..., 0] > 127
    (found,) = changed(image, change, "b").annotations
    assert found.outline is not None
    assert shown.shape[::-1] == changed(image, change, "b").size_px
    drawn = Image.new("L", shown.shape[::-1])
    ImageDraw.Draw(drawn).polygon(found.outline, fill=1)
    told = np.asarray(drawn) > 0
    assert (told & shown).sum() / (told | shown).sum() > 0.95


def test_brightness_contrast_and_noise_are_what_they_say() -> None:
    picture = np.random.default_rng(0).integers(90, 160, (200, 300, 3), dtype=np.uint8)
    mean = picture.mean()
    lighter = changed_picture(picture, ImageChange(brightness=0.1, contrast=0.25))
    expected = (picture - mean) * 1.25 + mean + 0.1 * 255
    assert np.abs(lighter - expected).max() <= 1.5
    noisy = changed_picture(picture, ImageChange(noise=0.02, noise_seed=3)).astype(float) - picture
    assert noisy.std() == pytest.approx(0.02 * 255, rel=0.03)
    assert np.abs(np.corrcoef(noisy[..., 0].ravel(), noisy[..., 1].ravel())[0, 1]) < 0.02
    again = changed_picture(picture, ImageChange(noise=0.02, noise_seed=3)).astype(float) - picture
    other = changed_picture(picture, ImageChange(noise=0.02, noise_seed=4)).astype(float) - picture
    assert (again == noisy).all()
    assert not (other == noisy).all()
    assert (changed_picture(picture, ImageChange()) == picture).all()


SIZE = (96, 64)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight pictures of cracks, two of potholes, two of nothing."""
    folder = tmp_path_factory.mktemp("balance") / "photos"
    for number in range(12):
        picture(folder / f"{number:02d}.jpg", SIZE, number)
        shown = "LC" if number < 8 else "PH"
        voc(folder / f"{number:02d}.xml", [(shown, (31, 21, 60, 40))] * (number < 10), SIZE)
    name, source = source_of("uapd")
    backgrounds = frozenset({"10.jpg", "11.jpg"})
    source = source.model_copy(update={"gsd_mm": 2.5})
    import_source(name, source, folder, folder.parent / "all", size=ImageSize(), backgrounds=backgrounds)
    return folder.parent / "all"


@pytest.fixture(scope="module")
def balanced(dataset: Path) -> Path:
    return balance(dataset, dataset.parent / "balanced", BalanceSettings()).folder


def test_classes_become_equal_and_backgrounds_keep_their_share(dataset: Path, balanced: Path) -> None:
    images = list(read_images(balanced))
    counts = Counter(each.category for image in images for each in image.labelled)
    assert counts["Single Crack"] == counts["Pothole"] == 8
    backgrounds = [image for image in images if image.is_background]
    assert len(backgrounds) / len(images) == pytest.approx(2 / 12, abs=0.05)
    originals = {image.name: image for image in read_images(dataset)}
    assert {image.name for image in images} >= originals.keys()


def test_copies_are_of_their_images(dataset: Path, balanced: Path) -> None:
    originals = {image.name: image for image in read_images(dataset)}
    copies = [image for image in read_images(balanced) if image.name not in originals]
    assert copies
    for copy in copies:
        image = originals[copy.attributes["copy_of"]]
        assert (copy.group, copy.gsd_mm, copy.source) == (image.group, 2.5, "uapd")
        with Image.open(balanced / "JPEGImages" / copy.picture) as shown:
            assert shown.size == copy.size_px
        changes = draw_change(image, int(copy.name[-2:]) - 1, BalanceSettings(), 0)
        assert str(changes) == copy.attributes["changes"]
        if image.is_background:
            assert not changes.rotation_deg
            assert not changes.noise
            assert abs(changes.brightness) <= BalanceSettings().brightness / 2
    assert any("rotated" in copy.attributes["changes"] for copy in copies)


def test_a_split_never_parts_copies_from_their_image(balanced: Path, tmp_path: Path) -> None:
    merged = merge([balanced], tmp_path / "merged").folder
    split_dataset(merged, (0.5, 0.25, 0.25))
    split_of = {name: split for split, names in split_names(merged).items() for name in names}
    assert {split_of[name] == split_of[name.partition("-copy-")[0]] for name in split_of if "-copy-" in name} == {True}


def test_again_or_resumed_it_is_the_same_bytes(dataset: Path, balanced: Path, tmp_path: Path) -> None:
    for _ in range(2):
        balance(dataset, tmp_path / "again", BalanceSettings())
        assert digests(tmp_path / "again") == digests(balanced)
        for path in sorted((tmp_path / "again" / "Annotations").glob("*-copy-*"))[:3]:
            path.unlink()
    balance(dataset, tmp_path / "other", BalanceSettings(), seed=1)
    assert digests(tmp_path / "other") != digests(balanced)


def test_what_a_copy_differs_in_depends_on_its_image_alone(dataset: Path) -> None:
    first, second = list(read_images(dataset))[:2]
    settings = BalanceSettings()
    changes = [draw_change(image, number, settings, 0) for image in (first, second) for number in (0, 1)]
    assert len(set(changes)) == 4
    assert draw_change(first, 1, settings, 0) == changes[1]
    drawn = [draw_change(first, number, settings, 0) for number in range(200)]
    assert np.mean([change.is_flipped for change in drawn]) == pytest.approx(0.5, abs=0.15)
    angles = [change.rotation_deg for change in drawn]
    assert (min(angles) < -12, max(angles) > 12, max(map(abs, angles)) <= 15) == (True, True, True)


def test_without_albumentations_one_line_says_how_to_get_it(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(name: str) -> None:
        raise ImportError(name)

    augmenting.albumentations.cache_clear()
    monkeypatch.setattr(augmenting, "import_module", missing)
    refused = plain_refusal(pavetwin("data", "balance", dataset, "-o", tmp_path / "out"))
    augmenting.albumentations.cache_clear()
    assert "not installed; get it with `pip install 'pavetwin[augment]'`" in refused
    assert not (tmp_path / "out").exists()


def test_the_command_prints_instances_before_and_after(dataset: Path, balanced: Path, tmp_path: Path) -> None:
    done = pavetwin("data", "balance", dataset, "-o", tmp_path / "out", "--copies", "3", "--target", "6", "--leave-out")
    assert done.returncode == 0, done.stderr
    rows = [line.split() for line in done.stdout.splitlines()]
    assert ["Single", "Crack", "8", "6", "100.0"] in rows
    assert ["Pothole", "2", "6", "100.0"] in rows
    assert "note: Car: the dataset shows none, so it cannot be balanced" in done.stderr
    assert "dropped: images: left out, so that no class has more than 6 instances (" in done.stderr
    for arguments, words in (
        ((dataset,), "Missing option '--output' / '-o'."),
        ((dataset, "-o", tmp_path / "no", "--copies", "999"), "--copies: it must be less than or equal to 200"),
        ((balanced, "-o", tmp_path / "no"), "holds copies already"),
        ((dataset, "-o", dataset), "needs a folder of its own"),
    ):
        assert words in plain_refusal(pavetwin("data", "balance", *arguments))


def test_a_damaged_picture_is_told_and_the_rest_goes_on(dataset: Path, tmp_path: Path) -> None:
    copied = merge([dataset], tmp_path / "copied").folder
    path = copied / "JPEGImages" / "uapd-08.jpg"
    damaged = path.read_bytes()[:-600]
    path.unlink()
    path.write_bytes(damaged)
    summary = balance(copied, tmp_path / "out", BalanceSettings())
    (told,) = [str(each) for each in summary.report if "damaged" in each.text]
    assert told.startswith("uapd-08: the picture is damaged; it is not copied")
    assert summary.images == len(list(read_images(tmp_path / "out"))) > 12


def test_a_recipe_balances_before_it_splits(dataset: Path, tmp_path: Path) -> None:
    (tmp_path / "recipe.yaml").write_text(
        f"sources: [{{source: uapd, folder: {dataset.parent / 'photos'}}}]\n"
        "balance: {copies: 4}\nsplit: [50, 25, 25]\nexport: [yolo]\n"
    )
    done = pavetwin("data", "build", tmp_path / "recipe.yaml", "-o", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert ["Pothole", "2", "8", "100.0"] in [line.split() for line in done.stdout.splitlines()]
    names = {image.name for image in read_images(tmp_path / "out" / "balanced")}
    assert {path.stem for path in (tmp_path / "out" / "export" / "labels").rglob("*.txt")} == names
    assert sum("-copy-" in name for name in names) == 6
    assert "Next: pavetwin data show" in done.stdout.splitlines()[-1]


@pytest.mark.slow
def test_real_photographs_are_balanced_within_5_percent(
    shared_file: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """More than 1,900 images of three sources; pictures are left out, since the labels alone are counted."""
    monkeypatch.setattr(balancing, "_encoded", lambda *_, **__: b"")
    china = shared_file("real/rdd2022_china_drone/China_Drone/train/images/China_Drone_000001.jpg").parents[2]
    cars = shared_file("real/aerial_cars/DJI-00760-00003.jpg").parent
    pdd = shared_file("real/uav_pdd2023_samples/LICENSE.md").parent
    bare = [
        f"train/images/{path.stem}.jpg"
        for path in (china / "train" / "annotations" / "xmls").glob("*.xml")
        if not re.search("<name>(D|Block)", path.read_text())
    ]
    folders = []
    for known, folder, backgrounds in (
        ("rdd2022-china-drone", china, bare),
        ("uav-cars", cars, []),
        ("uav-pdd2023", pdd, []),
    ):
        name, source = source_of(known)
        import_source(name, source, folder, tmp_path / name, size=ImageSize(), backgrounds=frozenset(backgrounds))
        folders.append(tmp_path / name)
    summary = balance(merge(folders, tmp_path / "all").folder, tmp_path / "balanced", BalanceSettings())
    counts = Counter(each.category for image in read_images(tmp_path / "balanced") for each in image.labelled)
    assert set(counts) == {"Single Crack", "Crocodile Crack", "Pothole", "Car"}
    assert min(counts.values()) >= 0.95 * max(counts.values())
    assert len(summary.plan.copies) >= 1950
