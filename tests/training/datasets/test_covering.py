"""Labels of what was painted: of masks, and of what is left of them under objects."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageDraw

from pavetwin.labels.boxes import of_mask
from pavetwin.labels.common_form import AnnotatedImage, Annotation
from pavetwin.labels.outlines import filled
from pavetwin.training.datasets.augmenting import ImageChange, changed, changed_picture
from pavetwin.training.datasets.blending import covered, pasted

SIZE = (120, 90)


@st.composite
def masks(draw: st.DrawFn) -> np.ndarray:
    """(90, 120) A rectangle, an ellipse, or both apart from each other."""
    drawn = Image.new("1", SIZE)
    pen = ImageDraw.Draw(drawn)
    for shape in draw(st.sampled_from([(pen.rectangle,), (pen.ellipse,), (pen.rectangle, pen.ellipse)])):
        left, top = draw(st.integers(20, 80)), draw(st.integers(20, 60))
        shape((left, top, left + draw(st.integers(3, 20)), top + draw(st.integers(3, 10))), fill=1)
    return np.array(drawn)


CHANGES = st.builds(ImageChange, st.booleans(), st.floats(-15, 15).map(lambda angle: round(angle, 1)))


@settings(max_examples=60, deadline=None)
@given(masks(), CHANGES)
def test_box_and_outline_enclose_what_is_painted_however_it_is_turned(mask: np.ndarray, change: ImageChange) -> None:
    label = pasted(mask, "Car", "c")
    image = AnnotatedImage("a", ".jpg", SIZE, "s", "a.jpg", "s:a", annotations=(label,))
    picture = np.repeat(np.where(mask, 255, 0).astype(np.uint8)[..., None], 3, axis=2)
    # Bilinear between whole pixels: a pixel that is lighter has its middle in the mask.
    painted = changed_picture(picture, change)[..., 0]
    shown = painted > 150
    copy = changed(image, change, "b")
    (found,) = copy.annotations
    left, top, right, bottom = of_mask(shown) or (0, 0, 0, 0)
    assert found.box[0] <= left
    assert found.box[1] <= top
    assert found.box[2] >= right
    assert found.box[3] >= bottom
    assert found.outline is not None
    told = filled(np.array(found.outline), copy.size_px)
    # Where a corner points inwards, a quarter of the brightness is left.
    assert told[painted > 200].all()
    assert not told[painted < 55].any()
    if change.rotation_deg == 0:
        assert found.box == (left, top, right, bottom)
        assert (told == shown).all()


@pytest.mark.parametrize("outline", [None, ((20.0, 30.0), (120.0, 30.0), (120.0, 40.0), (20.0, 40.0))])
@pytest.mark.parametrize("reason", [None, "hidden"])
def test_what_is_left_of_a_label_depends_on_the_share_that_is_visible(
    outline: tuple[tuple[float, float], ...] | None, reason: str | None
) -> None:
    """60 % keep it, below that it is ignored, below 5 % it is gone; the box is that of what is visible."""
    label = Annotation("Pothole", (20, 30, 120, 40), reason, outline)
    for visible, expected in ((100, reason), (61, reason), (60, reason), (59, "covered"), (5, "covered")):
        over = np.zeros((90, 140), dtype=bool)
        over[:, 20 + visible :] = True
        left = covered(label, over, (140, 90))
        assert left is not None
        assert (left.box, left.ignored) == ((20, 30, 20 + visible, 40), reason or expected)
        assert (left.outline is None) == (outline is None)
        if left.outline is not None:
            assert max(x for x, _ in left.outline) == 20 + visible
    over[:, 24:] = True
    assert covered(label, over, (140, 90)) is None


def test_of_an_outline_that_no_pixel_lies_in_the_box_counts() -> None:
    hair = Annotation("Single Crack", (10, 0, 11, 80), outline=((10.1, 0.0), (10.2, 0.0), (10.2, 80.0), (10.1, 80.0)))
    over = np.ones((90, 120), dtype=bool)
    assert covered(hair, over, SIZE) is None
