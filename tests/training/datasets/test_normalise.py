"""Scaling and tiling by their laws: boxes, outlines and ignored regions there and back, nothing beyond the image."""

from math import ceil

import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from pavetwin.labels.boxes import PixelBox, moved, scaled, share_within, within
from pavetwin.labels.common_form import AnnotatedImage, Annotation
from pavetwin.training.datasets.resizing import CUT, LEAST_SHARE, ImageSize, ImageView, seen_through, views

SIDE = st.integers(20, 900)


@st.composite
def annotations(draw: st.DrawFn, size_px: tuple[int, int]) -> Annotation:
    """A label or an ignored region, half of them with an outline that fills its box: four corners, one on each edge."""
    width, height = size_px
    left, top = draw(st.integers(0, width - 2)), draw(st.integers(0, height - 2))
    right, bottom = draw(st.integers(left + 2, width)), draw(st.integers(top + 2, height))
    outline = None
    if draw(st.booleans()):
        x, y = (draw(st.integers(low, high)) for low, high in ((left, right), (top, bottom)))
        corners = ((x, top), (right, y), (left + right - x, bottom), (left, top + bottom - y))
        outline = tuple((float(column), float(row)) for column, row in corners)
        if shapely.Polygon(outline).area < 1:
            outline = None
    ignored = draw(st.sampled_from([None, None, "hidden"]))
    return Annotation("Pothole", (left, top, right, bottom), ignored=ignored, outline=outline)


@st.composite
def images(draw: st.DrawFn) -> AnnotatedImage:
    size_px = (draw(SIDE), draw(SIDE))
    held = tuple(draw(annotations(size_px)) for _ in range(draw(st.integers(1, 4))))
    return AnnotatedImage("i", ".jpg", size_px, "uapd", "i.jpg", "i", 2.0, annotations=held)


@st.composite
def sizes(draw: st.DrawFn, tiles: bool | None = None) -> ImageSize:
    return ImageSize(
        longest_px=draw(st.integers(64, 400)),
        tiles=draw(st.booleans()) if tiles is None else tiles,
        tile_overlap=draw(st.floats(0.0, 0.5)),
        target_gsd_mm=draw(st.sampled_from([None, 2.0, 3.7])),
    )


def shown(image: AnnotatedImage, size: ImageSize) -> list[tuple[ImageView, AnnotatedImage]]:
    return [(view, seen_through(image, view, ".jpg")) for view in views(image, size)]


def back(box: PixelBox, view: ImageView) -> tuple[float, float, float, float]:
    """A box of a view in the picture's own pixels."""
    across, down = view.factors
    return moved(scaled(box, 1 / across, 1 / down), *view.window[:2])


@given(images(), sizes())
def test_views_cover_the_whole_picture_and_nothing_beyond_it(image: AnnotatedImage, size: ImageSize) -> None:
    windows = [view.window for view in views(image, size)]
    whole = shapely.box(0, 0, *image.size_px)
    assert shapely.union_all([shapely.box(*window) for window in windows]).equals(whole)
    for view in views(image, size):
        assert max(view.size_px) <= max(size.longest_px, 1)
        assert max(view.factors) <= 1.0 + 0.5 / min(view.window[2] - view.window[0], view.window[3] - view.window[1])


@given(images(), sizes())
def test_nothing_leaves_its_view_and_ignored_stays_ignored(image: AnnotatedImage, size: ImageSize) -> None:
    for view, seen in shown(image, size):
        frame = shapely.box(0, 0, *seen.size_px).buffer(0.01)
        touched = [each for each in image.annotations if within(each.box, view.window) is not None]
        assert len(seen.annotations) == len(touched)
        for before, after in zip(touched, seen.annotations, strict=True):  # AnnotatedImage checks the boxes itself
            if after.outline is not None:
                assert frame.contains(shapely.Polygon(after.outline))
                # An outline stays in its box, but for the rounding of the box to whole pixels.
                assert shapely.box(*after.box).buffer(1.01).contains(shapely.Polygon(after.outline))
            is_cut = share_within(before.box, view.window) < LEAST_SHARE
            assert after.ignored == (before.ignored or (CUT if is_cut else None))


@given(images(), sizes())
def test_boxes_come_back_from_where_they_are_seen(image: AnnotatedImage, size: ImageSize) -> None:
    for view, seen in shown(image, size):
        touched = [each for each in image.annotations if within(each.box, view.window) is not None]
        for before, after in zip(touched, seen.annotations, strict=True):
            inside = within(before.box, view.window)
            assert inside is not None
            # A pixel of the view, which is where edges are rounded to.
            for edge, exact, factor in zip(back(after.box, view), inside, view.factors * 2, strict=True):
                assert abs(edge - exact) <= 1.0 / factor + 1e-6


@given(images(), sizes(tiles=True))
def test_every_label_is_a_label_in_some_tile(image: AnnotatedImage, size: ImageSize) -> None:
    """Also one that is larger than a tile, unless every tile holds less than the least share of it."""
    tiles = shown(image, size)
    for each in image.labelled:
        best = max(share_within(each.box, view.window) for view, _ in tiles)
        labelled = sum(
            one.ignored is None
            for view, seen in tiles
            for before, one in zip(
                (other for other in image.annotations if within(other.box, view.window) is not None),
                seen.annotations,
                strict=True,
            )
            if before is each
        )
        assert (labelled > 0) == (best >= LEAST_SHARE)


@given(images(), st.integers(64, 400))
def test_tiles_without_overlap_share_out_an_outline(image: AnnotatedImage, longest_px: int) -> None:
    """Where tiles meet edge to edge, the parts of a convex outline make up all of it."""
    width, height = (ceil(side / longest_px) * longest_px for side in image.size_px)
    image = AnnotatedImage("i", ".jpg", (width, height), "uapd", "i.jpg", "i", annotations=image.annotations)
    tiles = shown(image, ImageSize(longest_px=longest_px, tiles=True, tile_overlap=0.0))
    for at, each in enumerate(image.annotations):
        if each.outline is None:
            continue
        found = 0.0
        for view, seen in tiles:
            here = [number for number, one in enumerate(image.annotations) if within(one.box, view.window)]
            part = seen.annotations[here.index(at)].outline if at in here else None
            found += shapely.Polygon(part).area if part is not None else 0.0
        corners = len(tiles) * 8
        assert found == pytest.approx(shapely.Polygon(each.outline).area, rel=1e-6, abs=corners * 0.01 * longest_px)


@given(images(), sizes(tiles=False))
def test_a_scaled_picture_keeps_its_ground_resolution_in_step(image: AnnotatedImage, size: ImageSize) -> None:
    ((_, seen),) = shown(image, size)
    assert image.gsd_mm is not None
    assert seen.gsd_mm == pytest.approx(image.gsd_mm * image.size_px[0] / seen.size_px[0], rel=1e-4)
    if size.target_gsd_mm is not None and max(seen.size_px) < size.longest_px:
        wanted = max(size.target_gsd_mm, image.gsd_mm)
        assert seen.gsd_mm == pytest.approx(wanted, rel=1.0 / min(seen.size_px))
