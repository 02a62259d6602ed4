"""A dataset in one file: the same labels and nearly the same pictures, in the room that is allowed."""

import json
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pavetwin.errors import PaveTwinError
from pavetwin.training.datasets.examples import Example, ExampleSet, mask_in, read_coco
from pavetwin.training.datasets.packs import PackOptions, read_examples, read_pack, write_pack
from scenes.command_line import pavetwin, plain_refusal
from scenes.drawn_roads import drawn_roads

SPLITS = ("train", "val")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return drawn_roads(tmp_path_factory.mktemp("roads"), {"train": 6, "val": 2}, size=(160, 120))


@pytest.fixture(scope="module")
def data(folder: Path) -> ExampleSet:
    return read_coco(folder, SPLITS)


def pixels(data: ExampleSet, example: Example) -> np.ndarray:
    return np.asarray(Image.open(BytesIO(data.encoded(example))).convert("RGB"), dtype=np.float64)


def test_a_packed_dataset_holds_the_same(data: ExampleSet, tmp_path: Path) -> None:
    path = tmp_path / "roads.pack"
    summary = write_pack([data], path, PackOptions())
    assert (summary.images, summary.quality) == (8, 90)
    assert summary.size_mb * 1e6 == path.stat().st_size
    (packed,) = read_examples([path])
    for one, other in zip(data.examples, packed.examples, strict=True):
        for name in ("name", "split", "size_px", "source", "is_synthetic"):
            assert getattr(one, name) == getattr(other, name)
        window = (0, 0, *one.size_px)
        for true, kept in zip(one.objects, other.objects, strict=True):
            assert (true.category, true.coarse, true.subtype, true.box) == (
                *(kept.category, kept.coarse, kept.subtype, kept.box),
            )
            assert (mask_in(true.shape, window) == mask_in(kept.shape, window)).all()
        assert np.abs(pixels(data, one) - pixels(packed, other)).mean() < 4
    again = tmp_path / "again.pack"
    write_pack([data], again, PackOptions())
    assert again.read_bytes() == path.read_bytes()
    assert [each.split for each in read_pack(path, ("val",)).examples] == ["val", "val"]


def test_datasets_with_pictures_of_one_name_keep_their_own(tmp_path: Path) -> None:
    colours = {"red": (200, 20, 20), "blue": (20, 20, 200)}
    for name, colour in colours.items():
        for path in drawn_roads(tmp_path / name, {"train": 1}).glob("images/train/*.png"):
            Image.new("RGB", (128, 96), colour).save(path)
    sets = [read_coco(tmp_path / name, SPLITS) for name in colours]
    write_pack(sets, tmp_path / "both.pack", PackOptions())
    packed = read_pack(tmp_path / "both.pack", SPLITS)
    assert [each.name for each in packed.examples] == ["000.png", "000.png"]
    for example, colour in zip(packed.examples, colours.values(), strict=True):
        assert pixels(packed, example).mean(axis=(0, 1)) == pytest.approx(colour, abs=12)


def test_the_quality_falls_until_the_file_is_small_enough(data: ExampleSet, tmp_path: Path) -> None:
    whole = write_pack([data], tmp_path / "a.pack", PackOptions())
    limit = 0.75 * whole.size_mb
    less = write_pack([data], tmp_path / "b.pack", PackOptions(most_mb=limit))
    assert less.size_mb <= limit
    assert less.quality < 90
    with pytest.raises(PaveTwinError, match=r"8 images need about .* MB at the lowest quality, and `most_mb` is 0.001"):
        write_pack([data], tmp_path / "c.pack", PackOptions(most_mb=0.001))
    assert not (tmp_path / "c.pack").exists()


def test_smaller_pictures_keep_their_labels_in_place(data: ExampleSet, tmp_path: Path) -> None:
    write_pack([data], tmp_path / "small.pack", PackOptions(longest_px=80))
    small = read_pack(tmp_path / "small.pack", SPLITS)
    for one, other in zip(data.examples, small.examples, strict=True):
        assert other.size_px == (80, 60)
        for true, kept in zip(one.objects, other.objects, strict=True):
            assert kept.box == tuple(value / 2 for value in true.box)
            if true.category not in ("Pothole", "Car"):
                continue  # thin lines may vanish
            mask = mask_in(true.shape, (0, 0, 160, 120)).reshape(60, 2, 80, 2).mean(axis=(1, 3)) > 127
            shared = mask & (mask_in(kept.shape, (0, 0, 80, 60)) > 0)
            assert shared.sum() > 0.97 * mask.sum()


@pytest.mark.parametrize("content", [b"", b"no archive", b"PK\x05\x06" + 18 * b"\0"])
def test_a_file_that_is_no_packed_dataset_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.pack"
    path.write_bytes(content)
    with pytest.raises(PaveTwinError, match="is no packed dataset, or damaged"):
        read_pack(path, SPLITS)


def test_the_commands_pack_and_refuse_plainly(folder: Path, tmp_path: Path) -> None:
    done = pavetwin("data", "pack", folder, "-o", tmp_path / "r.pack", "--splits", "val", "--quality", 50)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"2 images in {tmp_path / 'r.pack'}: 0.0 MB at quality 50")
    for words, told in (
        (("--splits", "vla"), "--splits: no split 'vla' (did you mean 'val'?)"),
        (("--max-mb", 0.001), "--max-mb is 0.001; pack fewer images or smaller ones (--longest)"),
        (("--quality", 500), "--quality 500: it must be from 1 to 100"),
    ):
        assert told in plain_refusal(pavetwin("data", "pack", folder, "-o", tmp_path / "n.pack", *words))
    path = folder / "annotations" / "instances_val.json"
    content = json.loads(path.read_text())
    content["annotations"][0]["bbox"] = [500, 0, 10, 10]
    broken = tmp_path / "broken" / "annotations"
    broken.mkdir(parents=True)
    (broken / "instances_val.json").write_text(json.dumps(content))
    line = plain_refusal(pavetwin("data", "pack", tmp_path / "broken", "-o", tmp_path / "n.pack"))
    assert "annotation 1 has a box that reaches out of its image" in line
    assert not (tmp_path / "n.pack").exists()
