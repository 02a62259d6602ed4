"""Problems of labels, lists of classes, masks and images are reported with name and line, and the import continues."""

import errno
import os
import struct
import zlib
from collections.abc import Callable
from math import nan
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pavetwin.errors import PaveTwinError
from pavetwin.labels.common_form import read_images
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
from scenes.photographs import coco, picture, voc, yolo

BOMB = """<?xml version="1.0"?>
<!DOCTYPE annotation [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>
<annotation><object><name>&b;</name></object></annotation>"""


def a_voc_file(folder: Path, text: str) -> None:
    picture(folder / "bad.jpg", seed=1)
    (folder / "bad.xml").write_text(text, encoding="utf-8")


def a_bomb(folder: Path) -> None:
    a_voc_file(folder, BOMB)


def a_name_that_climbs_out(folder: Path) -> None:
    picture(folder / "bad.jpg", seed=1)
    voc(folder / "bad.xml", [("PH", (1, 1, 9, 9))], filename="../../../etc/passwd")


def elements_without_end(folder: Path) -> None:
    a_voc_file(folder, f"<annotation>\n{'<a/>' * 200_000}</annotation>")


def a_stranger(folder: Path) -> None:
    picture(folder / "bad.jpg", seed=1)
    voc(folder / "bad.xml", [("LC", (1, 1, 9, 9)), ("longitudnal crack", (2, 2, 9, 9))])


def a_corner_without_a_number(folder: Path) -> None:
    picture(folder / "bad.jpg", seed=1)
    path = voc(folder / "bad.xml", [("LC", (1, 1, 9, 9))])
    path.write_text(path.read_text().replace("<ymin>1<", "<ymin>one<"))


def labels_of_another_picture(folder: Path) -> None:
    picture(folder / "bad.jpg", (80, 48), seed=1)
    voc(folder / "bad.xml", [("LC", (1, 1, 9, 9))])


def half_a_picture(folder: Path) -> None:
    whole = picture(folder / "bad.jpg", (256, 256), seed=1)
    whole.write_bytes(whole.read_bytes()[:-600])
    voc(folder / "bad.xml", [("LC", (1, 1, 9, 9))], (256, 256))


def chunk(kind: bytes, data: bytes) -> bytes:
    """Of a PNG."""
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def much_text_behind_the_pixels(folder: Path) -> None:
    whole = picture(folder / "bad.png", seed=1)
    text, end = chunk(b"zTXt", b"k\0\0" + zlib.compress(bytes(70 * 2**20))), chunk(b"IEND", b"")
    whole.write_bytes(whole.read_bytes().removesuffix(end) + text + end)
    voc(folder / "bad.xml", [("LC", (1, 1, 9, 9))])


def a_picture_that_claims(folder: Path, width: int, height: int) -> None:
    """So many pixels, in a few hundred bytes of PNG."""
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    rows = chunk(b"IDAT", zlib.compress(bytes(100_000)))
    (folder / "bad.png").write_bytes(b"\x89PNG\r\n\x1a\n" + header + rows + chunk(b"IEND", b""))
    voc(folder / "bad.xml", [("LC", (1, 1, 9, 9))])


def a_picture_of_gigabytes(folder: Path) -> None:
    a_picture_that_claims(folder, 60_000, 60_000)


def a_picture_just_too_large(folder: Path) -> None:
    a_picture_that_claims(folder, 12_000, 9_000)


def two_pictures_of_one_name(folder: Path) -> None:
    picture(folder / "bad.jpg", seed=1)
    picture(folder / "bad.png", seed=2)
    voc(folder / "bad.xml", [("LC", (1, 1, 9, 9))])


def two_labels_of_one_picture(folder: Path) -> None:
    voc(folder / "also" / "good.xml", [("LC", (1, 1, 9, 9))])


def swapped_corners(folder: Path) -> None:
    voc(folder / "good.xml", [("LC", (20, 31, 5, 11))])


def boxes_beyond_the_border(folder: Path) -> None:
    voc(folder / "good.xml", [("LC", (1, 1, 9, 9)), ("LC", (60, 40, 70, 60)), ("LC", (70, 1, 80, 9))])


def a_box_twice(folder: Path) -> None:
    voc(folder / "good.xml", [("LC", (1, 1, 9, 9)), ("LC", (1, 1, 9, 9))])


@pytest.mark.parametrize(
    ("spoil", "line"),
    [
        (
            a_bomb,
            "refused bad.xml:2: has a document type or entities, which label files never need; the image is left out",
        ),
        (
            a_name_that_climbs_out,
            "refused bad.xml:2: filename '../../../etc/passwd' leads out of the folder; the image is left out",
        ),
        (
            elements_without_end,
            "refused bad.xml:2: more than 200000 elements, which no label file has; the image is left out",
        ),
        (
            a_stranger,
            "refused bad.xml:7: class 'longitudnal crack' is not known (did you mean 'longitudinal crack'?); "
            "the image is left out",
        ),
        (a_corner_without_a_number, "refused bad.xml:5: ymin is 'one', which is not a number; the image is left out"),
        (
            labels_of_another_picture,
            "refused bad.xml:3: the labels are for 64 × 48 pixels, the picture has 80 × 48; the image is left out",
        ),
        (half_a_picture, "refused bad.jpg: the picture is damaged; the image is left out"),
        (much_text_behind_the_pixels, "refused bad.png: the picture is damaged; the image is left out"),
        (
            a_picture_of_gigabytes,
            "refused bad.png: the picture is too large; at most 100 million pixels are read; the image is left out",
        ),
        (
            a_picture_just_too_large,
            "refused bad.png: the picture has 12000 × 9000 pixels; at most 100 million are read; the image is left out",
        ),
        (two_pictures_of_one_name, "refused bad.xml: two files of one name, bad.jpg and bad.png; both are left out"),
        (two_labels_of_one_picture, "refused good.jpg: its labels are given twice; the second is left out"),
        (swapped_corners, "repaired good.xml:5: the corners of a box were swapped; put in order"),
        (a_box_twice, "dropped good.xml:7: the same box of the same class is given twice; kept once"),
    ],
)
def test_a_bad_file_is_told_and_the_rest_goes_on(tmp_path: Path, spoil: Callable[[Path], None], line: str) -> None:
    folder = tmp_path / "photos"
    picture(folder / "good.jpg")
    voc(folder / "good.xml", [("LC", (6, 12, 20, 31))])
    spoil(folder)
    assert told("uapd", folder) == [line]
    if spoil is swapped_corners:
        (image,) = read_images(tmp_path / "dataset")
        assert [each.box for each in image.labelled] == [(4, 10, 20, 31)]


def test_boxes_beyond_the_border_are_cut_or_left_out(tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    picture(folder / "good.jpg")
    boxes_beyond_the_border(folder)
    assert told("uapd", folder) == [
        "repaired good.xml:7: a box reached beyond the image; cut off at its border",
        "dropped good.xml:10: a box outside the image is left out",
    ]
    (image,) = read_images(tmp_path / "dataset")
    assert [each.box for each in image.labelled] == [(0, 0, 9, 9), (59, 39, 64, 48)]


@pytest.mark.parametrize(
    ("lines", "told_line"),
    [
        (("0 0.5 0.5 0.1 0.1", "0 0.5 0.5 0.1"), "bad.txt:2: 4 words where a class and four numbers should be"),
        (("0 0.5 0.5 0.1 0.1 0.9",), "bad.txt:1: 6 words where a class and four numbers should be"),
        (("this line has five words",), "bad.txt:1: 'this' is not a class number"),
        (("0 0.5 half 0.1 0.1",), "bad.txt:1: 'half' is not a number"),
        (("0 0.5 nan 0.1 0.1",), "bad.txt:1: 'nan' is not a finite number"),
        (("0 0.5 0.5 0.1 0.1", "", "3 0.5 0.5 0.1 0.1"), "bad.txt:3: class 3 where the dataset has 3, from 0"),
    ],
)
def test_a_line_that_is_no_object(tmp_path: Path, lines: tuple[str, ...], told_line: str) -> None:
    folder = tmp_path / "photos"
    for number, name in enumerate(("good", "bad")):
        picture(folder / f"{name}.jpg", seed=number)
    yolo(folder / "good.txt", "0 0.5 0.5 0.5 0.5")
    yolo(folder / "bad.txt", *lines)
    assert told("highrpd", folder) == [f"refused {told_line}; the image is left out"]


def test_a_polygon_of_two_corners(tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    for number, name in enumerate(("good", "bad")):
        picture(folder / f"{name}.jpg", seed=number)
    yolo(folder / "good.txt", "0 0.1 0.1 0.9 0.1 0.5 0.9")
    yolo(folder / "bad.txt", "0 0.5 0.5 0.1 0.1")
    (line,) = told("pothrgbd", folder)
    assert (
        line == "refused bad.txt:1: 5 words where a class and at least three corners should be; the image is left out"
    )


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
    """Folders, links to folders, label files; and names that are not text."""
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
        ("labels: {format: yolo}\nclasses: {hole: Pothole}\ngroup: '('\n", "is not a readable pattern"),
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
