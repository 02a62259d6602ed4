"""COCO files read entry by entry: the same as read whole, in any order of keys, and without holding them."""

import json
import tracemalloc
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pavetwin.training.datasets.layouts import coco as module
from pavetwin.training.datasets.layouts.coco import CocoFileError, coco_file

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
        ('{"images": [\n{"id": 1},\n]}', "Expecting value", 3),
        ('{"images": [], "annotations": [], "categories": []}\n{}', "Extra data", 2),
        ('{"images" []}', "Expecting ':' delimiter", 1),
        ('{"images": [{"id": 1}', "Expecting ',' delimiter", 1),
        ("", "Expecting value", 1),
        ("\n\n", "Expecting value", 3),
        (500 * "\0", "Expecting value", 1),
        ("[1, 2", "Expecting ',' delimiter", 1),
        ("{}\n[]", "Extra data", 2),
    ],
)
def test_what_is_no_json_is_told_with_its_line(tmp_path: Path, text: str, words: str, line: int) -> None:
    (tmp_path / "bad.json").write_text(text)
    with pytest.raises(CocoFileError, match=words) as error, coco_file(tmp_path / "bad.json"):
        pass
    assert error.value.line == line


@pytest.mark.parametrize(
    "text", ["[1, 2]", '[{"images": []}]', '{"info": []}', '"text"', '{"images": {}, "annotations": 1}', "{}"]
)
def test_other_json_is_no_coco(tmp_path: Path, text: str) -> None:
    (tmp_path / "other.json").write_text(text)
    with coco_file(tmp_path / "other.json") as found:
        assert found is None


def test_memory_holds_one_entry(tmp_path: Path) -> None:
    """A file of 12 MB, most of it in masks."""
    images = [{"id": number, "file_name": f"{number}.jpg"} for number in range(300)]
    annotations = [{"id": at, "image_id": at % 300, "segmentation": {"counts": 10_000 * "0"}} for at in range(1200)]
    content = {"annotations": annotations, "images": images, "categories": []}
    (tmp_path / "big.json").write_text(json.dumps(content))
    del content, annotations, images
    tracemalloc.start()
    with coco_file(tmp_path / "big.json") as found:
        assert found is not None
        assert sum(len(annotations) for _, annotations in found.images()) == 1200
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert (tmp_path / "big.json").stat().st_size > 12e6
    assert peak < 8e6
