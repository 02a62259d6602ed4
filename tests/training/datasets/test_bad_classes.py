"""Lists of classes, masks and pictures that are not what they should be, and what a report keeps."""

import errno
import os
import struct
from math import nan
from pathlib import Path
from time import process_time

import numpy as np
import pytest
from PIL import Image

from pavetwin.errors import PaveTwinError
from pavetwin.labels.common_form import read_images
from pavetwin.labels.voc import parse_xml
from pavetwin.training.datasets.importing import ImportSummary, convert, import_source
from pavetwin.training.datasets.layouts.layout import RawImage, RawObject
from pavetwin.training.datasets.layouts.yolo import names_in
from pavetwin.training.datasets.pictures import picture_size
from pavetwin.training.datasets.report import Finding, Report
from pavetwin.training.datasets.resizing import ImageSize
from pavetwin.training.datasets.sources import source_of
from pavetwin.training.datasets.sources.registry import outcome, unknown_class
from scenes.command_line import pavetwin, without_progress
from scenes.imports import told
from scenes.photographs import coco, picture, yolo


@pytest.mark.parametrize(
    ("label", "meant"), [("D0O", "D00"), ("d1O", "D10"), ("longitudnal_crack", "Longitudinal Crack")]
)
def test_a_class_is_suggested_as_its_source_spells_it(label: str, meant: str) -> None:
    rules = {"D00": "Single Crack", "D10": "Single Crack", "D40": "Pothole", "Longitudinal Crack": "Single Crack"}
    assert unknown_class(rules, label) == f"class '{label}' is not known (did you mean '{meant}'?)"
    assert outcome(rules, meant.upper().replace(" ", "_")) == rules[meant]


def test_one_class_that_becomes_two_is_refused(tmp_path: Path) -> None:
    mapping = tmp_path / "mine.yaml"
    mapping.write_text("labels: {format: coco}\nclasses: {big car: Car, Big-Car: Person}\n")
    with pytest.raises(PaveTwinError, match="'big car' and 'Big-Car' are compared as one class, and become two"):
        source_of(str(mapping))


@pytest.mark.parametrize(
    ("values", "lines"),
    [
        ((0, 255), []),
        ((0, 128), []),
        ((0, 0), ["dropped good.png: no valid box, and not listed as verified background; the image is left out"]),
        *(
            (
                (0, value),
                [
                    f"note good_hole.png: no pixel of this mask is brighter than {value} of 255, and only those from "
                    f"128 on count; multiply its values if they are 0 and {value}",
                    "dropped good.png: no valid box, and not listed as verified background; the image is left out",
                ],
            )
            for value in (1, 127)
        ),
    ],
)
def test_a_mask_that_is_too_dark_is_told(tmp_path: Path, values: tuple[int, int], lines: list[str]) -> None:
    picture(tmp_path / "photos" / "good.png")
    mask = np.full((48, 64), values[0], np.uint8)
    mask[10:20, 10:20] = values[1]
    Image.fromarray(mask).save(tmp_path / "photos" / "good_hole.png")
    assert [f"{each.finding.value} {each}" for each in of_masks(tmp_path).report] == lines


def test_masks_of_two_sizes_are_refused(tmp_path: Path) -> None:
    picture(tmp_path / "photos" / "good.png")
    for name, size in (("hole", (64, 48)), ("crack", (48, 64))):
        Image.new("L", size, 255).save(tmp_path / "photos" / f"good_{name}.png")
    assert list(map(str, of_masks(tmp_path).report)) == [
        "good.png: its masks are not of one size; the image is left out"
    ]


def of_masks(folder: Path) -> ImportSummary:
    """The import of `photos`, with masks of two classes."""
    mapping = folder / "mine.yaml"
    mapping.write_text(
        "labels: {format: masks, masks: {hole: _hole.png, crack: _crack.png}}\n"
        "classes: {hole: Pothole, crack: Single Crack}\n"
    )
    name, source = source_of(str(mapping))
    return import_source(name, source, folder / "photos", folder / "dataset", size=ImageSize())


@pytest.mark.parametrize(
    ("labels", "words"),
    [
        ("", "No image was imported: more.json:1: is not JSON (Expecting value). All findings are in "),
        ('{"images": []}', "No image was imported: more.json: has no list `categories` and no list `annotations`, as"),
        ("{}", "No image was imported: good.jpg: no valid box, and not listed as verified background; the image is "),
    ],
)
def test_an_import_of_no_image_is_an_error(tmp_path: Path, labels: str, words: str) -> None:
    mapping = tmp_path / "mine.yaml"
    mapping.write_text("labels: {format: coco}\nclasses: {car: Car}\n")
    picture(tmp_path / "photos" / "good.jpg")
    (tmp_path / "photos" / "more.json").write_text(labels)
    answer = pavetwin("data", "import", str(mapping), str(tmp_path / "photos"), "-o", str(tmp_path / "dataset"))
    assert answer.returncode == 2
    assert words in without_progress(answer.stderr)[-1]
    recipe = tmp_path / "recipe.yaml"
    recipe.write_text("sources: [{source: mine.yaml, folder: photos}]\n")
    answer = pavetwin("data", "build", str(recipe), "-o", str(tmp_path / "built"))
    assert answer.returncode == 2
    assert words in without_progress(answer.stderr)[-1]


def test_a_corner_that_is_not_finite_is_told_of_any_layout() -> None:
    outline = ((1.0, 1.0), (nan, 9.0), (9.0, 9.0))
    raw = RawImage(Path("bad.jpg"), "bad.jpg", "bad.any", (RawObject("car", (1, 1, 9, 9), 3, outline=outline),))
    report = Report()
    found = source_of("pavetwin")[1]
    assert convert(raw, found, (64, 48), report, source_name="any", name="any-bad", suffix=".jpg") is None
    assert list(map(str, report)) == ["bad.any:3: a corner of an outline is not finite; the image is left out"]


def test_a_coco_picture_whose_name_is_none(tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    picture(folder / "images" / "train" / "good.jpg")
    images: list[dict[str, object]] = [{"id": 1, "file_name": "good.jpg"}, {"id": 2, "file_name": "no\0name.jpg"}]
    annotations: list[dict[str, object]] = [
        {"id": number, "image_id": number, "category_id": 1, "bbox": [1, 2, 3, 4]} for number in (1, 2)
    ]
    coco(folder / "annotations" / "instances_train.json", images, annotations, ["Car"])
    (line,) = told("pavetwin", folder)
    assert line.endswith("leads out of the folder; the image is left out")


def test_an_orientation_that_is_none_is_as_stored(tmp_path: Path) -> None:
    path = picture(tmp_path / "text.jpg")
    text = b"Exif\0\0II*\0\x08\0\0\0" + struct.pack("<HHHI4sI", 1, 0x112, 2, 4, b"abc\0", 0)
    with Image.open(path) as image:
        image.save(path, exif=text)
    assert picture_size(path) == (64, 48)


def test_what_may_not_be_read_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Folders, links to folders, label files; and names that are no text."""
    folder = tmp_path / "photos"
    for number, name in enumerate(("good", "closed/one", "bad", "caf\udce9")):
        picture(folder / f"{name}.jpg", seed=number)
        yolo(folder / f"{name}.txt", "0 0.5 0.5 0.5 0.5" if name != "caf\udce9" else "0 0.5")
    (folder / "elsewhere").symlink_to(tmp_path)
    read_text, scandir = Path.read_text, os.scandir

    def refused(path: str) -> None:
        if Path(path).name in ("closed", "bad.txt"):
            raise PermissionError(errno.EACCES, "Permission denied", path)

    # As for a user who is not root, as who tests may run.
    monkeypatch.setattr(os, "scandir", lambda path: (refused(str(path)), scandir(path))[1])
    monkeypatch.setattr(Path, "read_text", lambda path, *a, **b: (refused(str(path)), read_text(path, *a, **b))[1])
    assert told("highrpd", folder) == [
        "note elsewhere: a link to another folder is not followed; what is in it is left out",
        "refused closed: the folder cannot be read; what is in it is left out",
        "refused bad.txt: cannot be read (Permission denied); the image is left out",
        "refused caf\udce9.txt:1: 2 words where a class and four numbers should be; the image is left out",
    ]
    assert "caf\\udce9.txt" in (tmp_path / "dataset" / "report.csv").read_text(encoding="utf-8")


def test_a_picture_that_was_turned_is_stored_as_it_is_seen(tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    picture(folder / "good.jpg", (64, 48))
    with Image.open(folder / "good.jpg") as seen:
        exif = Image.Exif()
        exif[0x0112] = 6
        turned = np.asarray(seen.transpose(Image.Transpose.ROTATE_270), dtype=float)
        seen.save(folder / "good.jpg", exif=exif, quality=95)
    yolo(folder / "good.txt", "0 0.25 0.5 0.5 1.0")
    assert told("highrpd", folder) == []
    (image,) = read_images(tmp_path / "dataset")
    assert (image.size_px, image.labelled[0].box) == ((48, 64), (0, 0, 24, 64))
    with Image.open(tmp_path / "dataset" / "JPEGImages" / image.picture) as stored:
        assert stored.size == (48, 64)
        assert stored.getexif().get(0x0112, 1) == 1
        assert np.abs(np.asarray(stored, dtype=float) - turned).mean() < 8


def test_the_same_stranger_again_is_one_line(tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    picture(folder / "good.jpg")
    yolo(folder / "good.txt", "0 0.5 0.5 0.5 0.5")
    for number in range(3):
        picture(folder / f"{number}.jpg", seed=number + 1)
        yolo(folder / f"{number}.txt", "1 0.5 0.5 0.5 0.5")
    mapping = tmp_path / "mine.yaml"
    mapping.write_text("labels: {format: yolo, names: [hole, hoel]}\nclasses: {hole: Pothole}\n")
    assert told(str(mapping), folder) == [
        "refused 0.txt:1: class 'hoel' is not known (did you mean 'hole'?); the image is left out (3 times)"
    ]


def test_a_report_keeps_so_many_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    from pavetwin.training.datasets import report as module

    monkeypatch.setattr(module, "MOST", 3)
    report = Report()
    for number in range(5):
        report.add(Finding.REFUSED, f"{number}.txt", "is not text")
    assert (len(list(report)), report.unlisted, report.counts[Finding.REFUSED]) == (3, 2, 5)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("labels: {format: yolo}\nclasses: {hole: Pothloe}\n", "'hole' becomes 'Pothloe' (did you mean 'Pothole'?)"),
        ("labels: {format: yolo}\nclases: {hole: Pothole}\n", "unknown key 'clases' (did you mean 'classes'?)"),
        ("labels: {format: yoloo}\nclasses: {hole: Pothole}\n", "'yoloo'"),
        ("labels: {format: yolo}\nclasses: {hole: Pothole}\ngroup: '('\n", "is no pattern that can be read"),
        ("labels: [\n", "is not valid YAML"),
    ],
)
def test_a_wrong_mapping_file_is_refused(tmp_path: Path, content: str, words: str) -> None:
    mapping = tmp_path / "mine.yaml"
    mapping.write_text(content)
    with pytest.raises(PaveTwinError) as refused:
        source_of(str(mapping))
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_text_of_many_lines_is_read_in_time_that_grows_with_it(tmp_path: Path) -> None:
    """A parser gives every line by itself: joined one by one, a megabyte of them took 15 s."""
    (tmp_path / "long.xml").write_text(f"<a>{2**20 * chr(10)}<b>word</b>{chr(10)}more</a>")
    started = process_time()
    root = parse_xml(tmp_path / "long.xml")
    assert process_time() - started < 3  # 0.1 s, and 15 s one by one
    assert (len(root.text), root.value("b")) == (2**20 + 5, "word")


ALIASES = "\n".join(["a0: &a0 [x, x]", *(f"a{n}: &a{n} [{', '.join(9 * [f'*a{n - 1}'])}]" for n in range(1, 12))])
MERGES = "\n".join(
    ["a0: &a0 {x: 1}", *(f"a{n}: &a{n} {{<<: [{', '.join(9 * [f'*a{n - 1}'])}]}}" for n in range(1, 12))]
)


@pytest.mark.parametrize(
    ("file", "content", "words"),
    [
        ("data.yaml", f"{ALIASES}\nnames: *a11\n", "class 0 has no name of 1 to 200 characters; put it in quotes"),
        ("data.yaml", f"{MERGES}\nnames: *a11\n", "has no list of classes"),
        ("dataset.yaml", "names: crack\n", "has no list of classes: `names` must be a list, as in [crack, pothole]"),
        ("data.yaml", "names: {0: crack, 2: hole}\n", "have a class for every number from 0"),
        ("data.yaml", "nc: 3\n", "has no list of classes"),
        ("data.yaml", "names: [crack, no]\n", "class 1 has no name of 1 to 200 characters; put it in quotes"),
        ("data.yaml", "names: [crack, ]\nnc: [\n", "is not YAML that can be read; give `names` in a mapping file"),
        ("data.yaml", "[" * 5000, "is not YAML that can be read"),
        ("classes.txt", f"crack\n{201 * 'e'}\n", "class 1 has no name of 1 to 200 characters"),
        ("data.yaml", "#" * (2**17 + 1), "is larger than 128 KiB, which no list of classes is"),
        ("classes.txt", "crack\0\udcff", "cannot be read as a list of classes"),
    ],
)
def test_a_list_of_classes_that_is_none(tmp_path: Path, file: str, content: str, words: str) -> None:
    (tmp_path / file).write_text(content, encoding="utf-8", errors="surrogateescape")
    with pytest.raises(PaveTwinError) as refused:
        names_in(tmp_path)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("file", "content"),
    [
        ("data.yaml", "names: [crack, 'no', 10]\n"),
        ("data.yaml", "names: {1: 'no', 0: crack, 2: 10}\n"),
        ("dataset.yaml", 'path: x\nnames:\n  0: &first crack\n  1: "no"\n  2: 10\n'),
        ("classes.txt", "crack\nno\n\n10\n"),
    ],
)
def test_a_list_of_classes_in_each_form(tmp_path: Path, file: str, content: str) -> None:
    (tmp_path / file).write_text(content)
    assert names_in(tmp_path) == ("crack", "no", "10")


def test_an_unknown_source_is_told_its_neighbour() -> None:
    with pytest.raises(PaveTwinError, match=r"`source`: no dataset source 'uadp' \(did you mean 'uapd'\?\)"):
        source_of("uadp")
