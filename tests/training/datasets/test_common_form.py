"""The common form on disk: what is written is read back, by us and by others' readers of Pascal VOC."""

from pathlib import Path

import pytest
import supervision as sv
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from pavetwin.errors import PaveTwinError
from pavetwin.labels.common_form import (
    AnnotatedImage,
    Annotation,
    as_xml,
    class_names,
    read_description,
    read_image,
    write_description,
)

TEXT = st.text(
    st.characters(min_codepoint=32, exclude_categories=("Cs", "Zs", "Zl", "Zp", "Cc", "Cn")), min_size=1, max_size=8
)
SHARES = st.floats(0, 1).map(lambda share: round(share, 2))


@st.composite
def annotated_images(draw: st.DrawFn) -> AnnotatedImage:
    width, height = draw(st.integers(2, 700)), draw(st.integers(2, 700))

    def annotation() -> Annotation:
        left, top = draw(st.integers(0, width - 1)), draw(st.integers(0, height - 1))
        box = (left, top, draw(st.integers(left + 1, width)), draw(st.integers(top + 1, height)))
        ignored = draw(st.none() | TEXT)
        category = draw(
            st.sampled_from(class_names()) if ignored is None else st.none() | st.sampled_from(class_names())
        )
        corners = st.tuples(SHARES, SHARES)
        outline = draw(st.none() | st.lists(corners, min_size=3, max_size=5).map(tuple))
        return Annotation(category, box, ignored, outline, draw(TEXT), draw(st.dictionaries(TEXT, TEXT, max_size=2)))

    annotations = tuple(annotation() for _ in range(draw(st.integers(0, 3))))
    return AnnotatedImage(
        name="image-1",
        suffix=".jpg",
        size_px=(width, height),
        source=draw(TEXT),
        original=draw(TEXT),
        group=draw(TEXT),
        gsd_mm=draw(st.none() | st.floats(0.1, 100)),
        is_background=not any(each.ignored is None for each in annotations) and draw(st.booleans()),
        annotations=annotations,
        attributes=draw(st.dictionaries(TEXT, TEXT, max_size=2)),
    )


@given(image=annotated_images())
def test_what_is_written_is_read_back(tmp_path_factory: pytest.TempPathFactory, image: AnnotatedImage) -> None:
    path = tmp_path_factory.getbasetemp() / "image-1.xml"
    path.write_bytes(as_xml(image))
    assert read_image(path) == image
    assert as_xml(read_image(path)) == path.read_bytes()


def test_others_read_it_as_pascal_voc(tmp_path: Path) -> None:
    annotations = (
        Annotation("Pothole", (0, 10, 20, 31), original="D40"),
        Annotation(None, (5, 5, 9, 9), ignored="class 'Block crack'"),
    )
    image = AnnotatedImage("a", ".jpg", (64, 48), "uapd", "a.JPG", "uapd:a.JPG", annotations=annotations)
    for name in ("Annotations", "JPEGImages"):
        (tmp_path / name).mkdir()
    (tmp_path / "Annotations" / "a.xml").write_bytes(as_xml(image))
    Image.new("RGB", (64, 48)).save(tmp_path / "JPEGImages" / "a.jpg")
    found = sv.DetectionDataset.from_pascal_voc(str(tmp_path / "JPEGImages"), str(tmp_path / "Annotations"))
    assert found.classes == ["Pothole", "ignored"]
    (_, _, detections) = next(iter(found))
    assert detections.xyxy.tolist() == [[0, 10, 20, 31], [5, 5, 9, 9]]


@pytest.mark.parametrize(
    ("annotations", "words"),
    [
        ([Annotation("Car", (0, 0, 65, 10))], "not within"),
        ([Annotation("Car", (5, 5, 5, 10))], "not within"),
    ],
)
def test_no_box_leaves_its_image(annotations: list[Annotation], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        AnnotatedImage("a", ".jpg", (64, 48), "uapd", "a", "a", annotations=tuple(annotations))


def test_an_annotation_is_of_a_class_or_ignored() -> None:
    with pytest.raises(ValueError, match="must be ignored"):
        Annotation(None, (0, 0, 1, 1))
    with pytest.raises(ValueError, match="'D00' is not a class"):
        Annotation("D00", (0, 0, 1, 1))


def test_a_damaged_dataset_is_refused_plainly(tmp_path: Path) -> None:
    with pytest.raises(PaveTwinError, match="holds no dataset"):
        read_description(tmp_path)
    write_description(tmp_path, {"complete": True})
    assert read_description(tmp_path)["complete"] is True
    (tmp_path / "dataset.yaml").write_text("format: 99\n")
    with pytest.raises(PaveTwinError, match="has format 99"):
        read_description(tmp_path)
    (tmp_path / "a.xml").write_text("<annotation><size/></annotation>")
    with pytest.raises(PaveTwinError, match=r"a\.xml' is damaged \(annotation has no source\)"):
        read_image(tmp_path / "a.xml")
