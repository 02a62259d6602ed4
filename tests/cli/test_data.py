"""`pavetwin data …` as a user types it."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from scenes.command_line import pavetwin, plain_refusal, without_progress
from scenes.photographs import picture, voc


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    """Two good pictures and one whose class nobody knows."""
    objects = {"a": "LC", "b": "PH", "c": "rutting"}
    for number, (name, label) in enumerate(objects.items()):
        picture(tmp_path / "photos" / f"{name}.jpg", seed=number)
        voc(tmp_path / "photos" / f"{name}.xml", [(label, (1, 1, 9, 9)), ("RP", (2, 2, 5, 5))])
    return tmp_path / "photos"


def test_an_import_lists_refused_files_and_exits_with_1(photos: Path, tmp_path: Path) -> None:
    done = pavetwin("data", "import", "uapd", photos, "-o", tmp_path / "out")
    assert done.returncode == 1
    assert "refused: c.xml:4: class 'rutting' is not known; the image is left out" in done.stderr.splitlines()
    assert f"1 refused; all in {tmp_path}/out/report.csv" in done.stderr
    assert done.stdout.startswith(f"2 images in {tmp_path}/out/. Next: pavetwin data stats")
    assert (tmp_path / "out" / "report.csv").read_text().splitlines() == [
        "finding,file,line,count,text",
        "refused,c.xml,4,1,class 'rutting' is not known; the image is left out",
    ]
    (photos / "c.xml").unlink()
    (photos / "c.jpg").unlink()
    done = pavetwin("data", "import", "uapd", photos, "-o", tmp_path / "again", "--gsd", "2.5")
    assert (done.returncode, without_progress(done.stderr)) == (0, [])


def test_stats_count_instances_and_images_by_source(photos: Path, tmp_path: Path) -> None:
    pavetwin("data", "import", "uapd", photos, "-o", tmp_path / "out")
    done = pavetwin("data", "stats", tmp_path / "out")
    assert done.returncode == 0
    source, *instances, ignored, annotated, background, total, scenes = done.stdout.splitlines()[-1].split()
    assert (source, instances) == ("uapd", ["1", "0", "1", "0", "0"])
    assert (ignored, annotated, background, total, scenes) == ("0", "2", "0", "2", "2")


def test_sources_are_listed_with_page_and_licence() -> None:
    text = pavetwin("data", "sources").stdout
    assert "uav-pdd2023: UAV-PDD2023\n  https://zenodo.org/records/8429208 · licence: CC BY 4.0" in text
    assert "line → Single Crack; block → Crocodile Crack; pit → discard image" in text


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("uadp", "photos", "-o", "out"), "no dataset source 'uadp' (did you mean 'uapd'?)"),
        (("uapd", "nowhere", "-o", "out"), "There is no folder 'nowhere'"),
        (("uapd", "photos"), "Missing option '--output'"),
        (("uapd", "photos", "-o", "out", "--longest", "10"), "--longest: it must be greater than or equal to 64"),
        (("uapd", "photos", "-o", "out", "--gsd", "0"), "gsd_mm: it must be greater than 0"),
    ],
)
def test_wrong_arguments_are_refused_in_one_line(photos: Path, arguments: tuple[str, ...], words: str) -> None:
    assert words in plain_refusal(pavetwin("data", "import", *arguments, cwd=photos.parent))
    assert not (photos.parent / "out").exists()


def test_a_background_that_is_not_there_is_refused(photos: Path, tmp_path: Path) -> None:
    (tmp_path / "checked.txt").write_text("a.jpeg\n")
    done = pavetwin("data", "import", "uapd", photos, "-o", tmp_path / "out", "--background", tmp_path / "checked.txt")
    assert "no picture 'a.jpeg' (did you mean 'a.jpg'?)" in plain_refusal(done)


def test_datasets_are_merged_and_shown(photos: Path, tmp_path: Path) -> None:
    for name in ("one", "two"):
        pavetwin("data", "import", "uapd", photos, "-o", tmp_path / name)
    done = pavetwin("data", "merge", tmp_path / "one", tmp_path / "two", "-o", tmp_path / "all")
    assert done.returncode == 0, done.stderr
    assert "dropped: two/uapd-a: the same picture as one/uapd-a" in done.stderr
    assert done.stdout.startswith(f"2 images in {tmp_path}/all/.")
    assert pavetwin("data", "show", tmp_path / "all").stdout == f"2 images on {tmp_path}/all/contact-sheet.png\n"
    with Image.open(tmp_path / "all" / "contact-sheet.png") as sheet:
        blue = (np.asarray(sheet) == (0x56, 0xB4, 0xE9)).all(axis=2)
    # The legend's square, and the box of the only Single Crack.
    assert blue[:132].sum() > 200
    assert blue[132:].sum() > 50
    assert "end its name in .png or .jpg" in plain_refusal(pavetwin("data", "show", tmp_path / "all", "-o", "x.gif"))
    assert "Missing option '--output'" in plain_refusal(pavetwin("data", "merge", tmp_path / "one"))


def test_a_dataset_is_split_and_exported(tmp_path: Path) -> None:
    for number in range(12):
        picture(tmp_path / "photos" / f"{number}.jpg", seed=number)
        voc(tmp_path / "photos" / f"{number}.xml", [("LC", (1, 1, 9, 9))])
    pavetwin("data", "import", "uapd", tmp_path / "photos", "-o", tmp_path / "all")
    refused = plain_refusal(pavetwin("data", "export", tmp_path / "all", "-o", tmp_path / "out"))
    assert "is not split yet; do so with `pavetwin data split" in refused
    done = pavetwin("data", "split", tmp_path / "all", "--shares", "50/25/25")
    assert [line.split() for line in done.stdout.splitlines()[1:]] == [
        ["Single", "Crack", "50.0", "25.0", "25.0"],
        ["images", "50.0", "25.0", "25.0"],
    ]
    done = pavetwin("data", "export", tmp_path / "all", "-o", tmp_path / "out")
    assert done.stdout == f"12 images as yolo, 12 images as coco in {tmp_path}/out/\n"
    assert len(list((tmp_path / "out" / "labels" / "train").iterdir())) == 6
    assert "--shares 1/2: expected the percentages" in plain_refusal(
        pavetwin("data", "split", tmp_path / "all", "--shares", "1/2")
    )
    assert "--shares: train, val and test must sum to 100 %" in plain_refusal(
        pavetwin("data", "split", tmp_path / "all", "--shares", "50/20/10")
    )
