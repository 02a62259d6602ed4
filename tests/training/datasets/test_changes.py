"""Copies of images by the laws of their boxes, and by what their pictures show."""

from math import cos, radians, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image, ImageDraw

from pavetwin.labels.boxes import flipped
from pavetwin.labels.common_form import AnnotatedImage, Annotation
from pavetwin.training.datasets.augmenting import (
    GONE_SHARE,
    ImageChange,
    changed,
    changed_picture,
    moved_points,
    shown_window,
)
from pavetwin.training.datasets.resizing import CUT, LEAST_SHARE

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
