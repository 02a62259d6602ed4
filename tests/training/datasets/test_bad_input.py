"""Problems of label files are reported with name and line, and the import continues."""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest

from pavetwin.labels.common_form import read_images
from scenes.imports import told
from scenes.photographs import picture, voc, yolo

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
        (a_corner_without_a_number, "refused bad.xml:5: ymin is 'one', which is no number; the image is left out"),
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
        (("this line has five words",), "bad.txt:1: 'this' is no number of a class"),
        (("0 0.5 half 0.1 0.1",), "bad.txt:1: 'half' is no number"),
        (("0 0.5 nan 0.1 0.1",), "bad.txt:1: 'nan' is no finite number"),
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
