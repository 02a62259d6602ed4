"""COCO files: read entry by entry, in any order of keys; problems are reported with their line."""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pavetwin.labels.common_form import read_images
from pavetwin.training.datasets.importing import import_source
from pavetwin.training.datasets.layouts import coco as module
from pavetwin.training.datasets.layouts.coco import CocoFileError, coco_file
from pavetwin.training.datasets.resizing import ImageSize
from pavetwin.training.datasets.sources import source_of
from scenes.imports import told
from scenes.photographs import coco, picture


def test_a_coco_file_that_climbs_out_or_has_no_place(tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    picture(folder / "images" / "train" / "good.jpg")
    picture(folder / "images" / "train" / "bad.jpg", seed=1)
    picture(tmp_path / "secret.jpg", seed=2)
    images: list[dict[str, object]] = [
        {"id": 1, "file_name": "good.jpg"},
        {"id": 2, "file_name": "../../../secret.jpg"},
        {"id": 3, "file_name": "bad.jpg"},
    ]
    annotations: list[dict[str, object]] = [
        {"id": 1, "image_id": 1, "category_id": 1, "bbox": [1, 2, 3, 4]},
        {"id": 2, "image_id": 2, "category_id": 1, "bbox": [1, 2, 3, 4]},
        {"id": 3, "image_id": 3, "category_id": 1},
    ]
    coco(folder / "annotations" / "instances_train.json", images, annotations, ["Car"])
    (folder / "broken.json").write_text('{"images": [\n')
    assert told("pavetwin", folder) == [
        "refused annotations/instances_train.json:1: file_name '../../../secret.jpg' leads out of the folder; "
        "the image is left out",
        "refused annotations/instances_train.json:1: image 'images/train/bad.jpg': annotation 3 has neither bbox nor "
        "segmentation; the image is left out",
        "refused broken.json:2: is not JSON (Expecting value)",
    ]


def test_a_coco_name_that_is_too_long_for_a_file_is_its_own_fault_alone(tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    picture(folder / "images" / "train" / "good.jpg")
    images: list[dict[str, object]] = [{"id": 1, "file_name": "a" * 6000 + ".jpg"}, {"id": 2, "file_name": "good.jpg"}]
    annotations: list[dict[str, object]] = [
        {"id": number, "image_id": number, "category_id": 1, "bbox": [1, 2, 3, 4]} for number in (1, 2)
    ]
    coco(folder / "annotations" / "instances_train.json", images, annotations, ["Car"])
    (line,) = told("pavetwin", folder)
    assert line.startswith("note annotations/instances_train.json:1: there is no picture 'aaaa")
    assert line.endswith("aaa.jpg'; left out")
    assert len(line) < 500


def coco_lines(folder: Path, image: str = "", annotation: str = '"bbox": [1, 2, 3, 4]') -> None:
    """A COCO file of two images: of the one named bad with more in its entry (line 4) or its annotation's (line 7)."""
    for seed, name in enumerate(("good", "bad")):
        picture(folder / "images" / "train" / f"{name}.jpg", seed=seed)
    (folder / "annotations").mkdir()
    (folder / "annotations" / "instances_train.json").write_text(
        f"""{{"categories": [{{"id": 1, "name": "Car"}}],
"images": [
{{"id": 1, "file_name": "good.jpg"}},
{{"id": 2, "file_name": "bad.jpg"{image and ", "}{image}}}],
"annotations": [
{{"id": 1, "image_id": 1, "category_id": 1, "bbox": [1, 2, 3, 4]}},
{{"id": 2, "image_id": 2, "category_id": 1{annotation and ", "}{annotation}}}]}}"""
    )


MANY_DIGITS = 5000 * "1"


@pytest.mark.parametrize(
    ("annotation", "words"),
    [
        ("", "annotation 2 has neither bbox nor segmentation"),
        ('"bbox": [1, 2, 3]', "the bbox of annotation 2 is not four finite numbers"),
        ('"bbox": [1, 2, 3, NaN]', "the bbox of annotation 2 is not four finite numbers"),
        ('"bbox": [1e308, 2, 1e308, 4]', "the bbox of annotation 2 is not four finite numbers"),
        (f'"bbox": [1, 2, 3, {MANY_DIGITS}]', "the bbox of annotation 2 is not four finite numbers"),
        ('"segmentation": [[1, 1, NaN, 9, 9, 9]], "bbox": [1, 2, 3, 4]', "POLYGONS"),
        ('"segmentation": [[1, 1, 9, 9, 5]]', "POLYGONS"),
        ('"segmentation": [1, 1, 9, 9, 5, 5]', "POLYGONS"),
        ('"segmentation": {"size": [64, 48], "counts": [3072]}', "SIZE"),
        ('"segmentation": {"size": [Infinity, 64], "counts": [1]}', "SIZE"),
        (
            '"segmentation": {"size": [48, 64]}',
            "the run lengths of the mask of annotation 2 do not fill its size",
        ),
        (  # of which the sum is right in 64 bits
            f'"segmentation": {{"size": [48, 64], "counts": [{2**63 - 1}, {2**63 - 1}, {48 * 64 + 2}]}}',
            "the run lengths of the mask of annotation 2 do not fill its size",
        ),
        (
            f'"segmentation": {{"size": [48, 64], "counts": "{"o" * 300_000}"}}',
            "the mask of annotation 2: a run length has more than 60 bits",
        ),
        (
            '"segmentation": {"size": [48, 64], "counts": "04"}',
            "the mask of annotation 2: run lengths that do not fill a mask of 48 × 64",
        ),
        ('"category_id": [1], "bbox": [1, 2, 3, 4]', "annotation 2 has category [1], which is not listed"),
    ],
)
def test_an_annotation_that_is_not_as_coco_has_it(tmp_path: Path, annotation: str, words: str) -> None:
    coco_lines(tmp_path / "photos", annotation=annotation)
    known = {
        "POLYGONS": "the segmentation of annotation 2 is not a list of polygons, each x, y, x, y … in finite numbers",
        "SIZE": "the mask of annotation 2 has not the picture's size, 64 × 48 pixels",
    }
    place = "annotations/instances_train.json:7: image 'images/train/bad.jpg'"
    assert told("pavetwin", tmp_path / "photos") == [
        f"refused {place}: {known.get(words, words)}; the image is left out"
    ]


@pytest.mark.parametrize(
    ("image", "words"),
    [
        ('"camera": [1]', "'camera' holds no values by name"),
        (
            '"camera": {"gsd_mm": 9, "heading_deg": 0}, "light": {"sun_azimuth_deg": NaN, "cloud_cover": 0}',
            "heading_deg, sun_azimuth_deg, sun_elevation_deg, cloud_cover are not all finite numbers",
        ),
    ],
)
def test_an_image_of_a_capture_that_is_not_as_captures_have_it(tmp_path: Path, image: str, words: str) -> None:
    coco_lines(tmp_path / "photos", image)
    place = "annotations/instances_train.json:4: image 'images/train/bad.jpg'"
    assert told("pavetwin", tmp_path / "photos") == [f"refused {place}: {words}; the image is left out"]


@pytest.mark.parametrize("gsd_mm", ["0", "1e300", "NaN", MANY_DIGITS, "true", '"9"'])
def test_a_ground_resolution_that_is_none_is_not_taken(tmp_path: Path, gsd_mm: str) -> None:
    """Neither of any COCO file nor of a capture's."""
    mapping = tmp_path / "mine.yaml"
    mapping.write_text("labels: {format: coco}\nclasses: {car: Car}\n")
    for source, image in ((str(mapping), '"gsd_mm": {}'), ("pavetwin", '"camera": {{"gsd_mm": {}}}')):
        name, found = source_of(source)
        folder = tmp_path / name
        coco_lines(folder, image.format(gsd_mm))
        summary = import_source(name, found, folder, tmp_path / f"{name}-dataset", size=ImageSize())
        assert [str(each) for each in summary.report] == [
            "annotations/instances_train.json:4: image 'images/train/bad.jpg': gsd_mm is not above 0 and at most 1000; "
            "taken as not known"
        ]
        assert [each.gsd_mm for each in read_images(summary.folder)] == [None, None]


def a_coco_file_without(folder: Path, key: str) -> None:
    path = folder / "annotations" / "more.json"
    path.write_text(path.with_name("instances_train.json").read_text().replace(key, "other"))


def a_coco_file_of_zero_bytes(folder: Path) -> None:
    (folder / "annotations" / "more.json").write_bytes(bytes(500))


def two_images_of_one_id(folder: Path) -> None:
    path = folder / "annotations" / "instances_train.json"
    picture(folder / "images" / "train" / "third.jpg", seed=7)
    more = '{"id": 2, "file_name": "third.jpg"}, 5],\n"annotations": [3,'
    path.write_text(path.read_text().replace('],\n"annotations": [', f",\n{more}"))


def an_image_without_an_id(folder: Path) -> None:
    path = folder / "annotations" / "instances_train.json"
    path.write_text(path.read_text().replace('"id": 2, "file_name"', '"file_name"'))


MISSED = "note annotations/instances_train.json:7: an annotation is of an image that is not listed; left out"


@pytest.mark.parametrize(
    ("spoil", "lines", "left"),
    [
        (a_coco_file_of_zero_bytes, ["refused annotations/more.json:1: is not JSON (Expecting value)"], 2),
        (
            partial(a_coco_file_without, key="annotations"),
            ["note annotations/more.json: has no list `annotations`, as COCO has; left out"],
            2,
        ),
        (
            two_images_of_one_id,
            [
                "refused annotations/instances_train.json:5: an entry is not an object; left out (2 times)",
                "refused annotations/instances_train.json:4: image 'images/train/bad.jpg' has the id 2 of another "
                "image; the image is left out",
                "refused annotations/instances_train.json:5: image 'images/train/third.jpg' has the id 2 of another "
                "image; the image is left out",
            ],
            1,
        ),
        (
            an_image_without_an_id,
            [
                MISSED,
                "refused annotations/instances_train.json:4: image 'images/train/bad.jpg' has no id; the image is left "
                "out",
            ],
            1,
        ),
    ],
)
def test_a_coco_file_that_lacks_what_it_needs(
    tmp_path: Path, spoil: Callable[[Path], None], lines: list[str], left: int
) -> None:
    coco_lines(tmp_path / "photos")
    spoil(tmp_path / "photos")
    name, source = source_of("pavetwin")
    summary = import_source(name, source, tmp_path / "photos", tmp_path / "dataset", size=ImageSize())
    assert [f"{each.finding.value} {each}" for each in summary.report] == lines
    assert summary.images == len(list(read_images(summary.folder))) == left


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=6,
)


@st.composite
def files(draw: st.DrawFn) -> dict[str, Any]:
    """A COCO file's content with its keys in any order and others between them."""
    ids = draw(st.lists(st.integers(0, 9) | st.text(max_size=2), min_size=1, max_size=4, unique=True))
    images = [{"id": one, "file_name": draw(st.text(max_size=5)), "more": draw(JSON)} for one in ids]
    numbers = st.sampled_from(ids) | st.just(77)
    annotations = [{"image_id": draw(numbers), "bbox": draw(JSON)} for _ in range(draw(st.integers(0, 6)))]
    content = {"info": draw(JSON), "licenses": draw(JSON), "images": images, "annotations": annotations}
    content["categories"] = [{"id": 1, "name": "hole"}]
    return {key: content[key] for key in draw(st.permutations(list(content)))}


@settings(max_examples=40, deadline=None)
@given(files(), st.integers(1, 60), st.sampled_from([None, 1]), st.booleans())
def test_every_image_comes_with_its_annotations(
    tmp_path_factory: pytest.TempPathFactory, content: dict[str, Any], chunk: int, indent: int | None, ascii_only: bool
) -> None:
    path = tmp_path_factory.getbasetemp() / "file.json"
    path.write_text(json.dumps(content, indent=indent, ensure_ascii=ascii_only), encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch, coco_file_in_chunks(patch, chunk, path) as found:
        assert found is not None
        read = [(image.content, [each.content for each in annotations]) for image, annotations in found.images()]
        assert found.categories == content["categories"]
    images = sorted(content["images"], key=lambda image: image["file_name"])
    assert read == [(each, [a for a in content["annotations"] if a["image_id"] == each["id"]]) for each in images]


def coco_file_in_chunks(patch: pytest.MonkeyPatch, chunk: int, path: Path) -> Any:
    patch.setattr(module, "CHUNK", chunk)
    return coco_file(path)


@pytest.mark.parametrize(
    ("text", "words", "line"),
    [
        ('{"images": [\n', "Expecting value", 2),
        ('{"images": [{"id": 1}\n\n{"id": 2}]}', "Expecting ',' delimiter", 3),
        ('{"images": [], "annotations": [], "categories": []}\n{}', "Extra data", 2),
        ('{"images" []}', "Expecting ':' delimiter", 1),
        ("", "Expecting value", 1),
        ("[1, 2", "Expecting ',' delimiter", 1),
    ],
)
def test_what_is_no_json_is_told_with_its_line(tmp_path: Path, text: str, words: str, line: int) -> None:
    (tmp_path / "bad.json").write_text(text)
    with pytest.raises(CocoFileError, match=words) as error, coco_file(tmp_path / "bad.json"):
        pass
    assert error.value.line == line


@pytest.mark.parametrize("text", ['[{"images": []}]', '{"info": []}', '{"images": {}, "annotations": 1}'])
def test_other_json_is_no_coco(tmp_path: Path, text: str) -> None:
    (tmp_path / "other.json").write_text(text)
    with coco_file(tmp_path / "other.json") as found:
        assert found is None
