"""What an instance image says: boxes, masks, shares, and what of it is left out of the labels."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pycocotools import mask as coco_mask

from pavetwin.capture.truth import (
    ContrastMeter,
    LabelledObject,
    Reason,
    SceneState,
    ground_fraction,
    inside_fraction,
    instance_masks,
    labelled_objects,
)
from pavetwin.labels.classes import CAR, PERSON, categories, category_of_agent, category_of_defect
from pavetwin.labels.rle import decode, encode
from pavetwin.render.frame import RenderedFrame
from pavetwin.scene.values import agent_label, defect_label
from pavetwin.scene.view import View, look
from scenes.tiny import Size, defect, passing, straight, trace_of

SIZE = 200
"""Of the images here, in pixels; one shows 20 × 20 m from 10 m."""

shapes = st.tuples(st.integers(1, 40), st.integers(1, 40))
masks = shapes.flatmap(lambda shape: arrays(np.bool_, shape))
label_images = shapes.flatmap(lambda shape: arrays(np.uint32, shape, elements=st.sampled_from([0, 1, 2, 9, 1 << 23])))


@given(label_images)
def test_boxes_are_tight_and_masks_are_the_instance_images(labels: np.ndarray) -> None:
    found = instance_masks(labels)
    assert [instance.label for instance in found] == sorted(set(labels[labels > 0].tolist()))
    for instance in found:
        mask = instance.mask(labels.shape)
        assert (mask == (labels == instance.label)).all()
        rows, columns = np.nonzero(mask)
        assert instance.box == (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)
        assert instance.area_px == mask.sum()


@given(label_images)
def test_what_touches_the_border_has_a_pixel_on_it(labels: np.ndarray) -> None:
    for instance in instance_masks(labels):
        mask = labels == instance.label
        assert instance.touches_border(labels.shape) == bool(
            mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any()
        )


@given(masks)
def test_run_lengths_are_those_of_pycocotools(mask: np.ndarray) -> None:
    text = encode(mask)
    assert text == coco_mask.encode(np.asfortranarray(mask.astype(np.uint8)))["counts"].decode()
    assert (decode(text, mask.shape) == mask).all()


def test_run_lengths_of_another_size_are_refused() -> None:
    with pytest.raises(ValueError, match="run lengths"):
        decode(encode(np.ones((4, 4), dtype=bool)), (5, 4))


def test_numbers_of_classes_never_change() -> None:
    names = [category.name for category in categories()]
    assert names[:5] == ["Single Crack", "Crocodile Crack", "Pothole", "Person", "Car"]
    assert [category.number for category in categories()] == list(range(len(names)))
    assert category_of_defect("pothole").number == 2
    assert category_of_agent(is_pedestrian=True) is PERSON
    assert category_of_agent(is_pedestrian=False) is CAR


# --- One image over a street with a pothole, a crack and a car ----------------------------------------------------

POTHOLE, CRACK, AGENT = defect_label(0), defect_label(1), agent_label(0)


@pytest.fixture
def moment() -> SceneState:
    hole = defect(0, 30.0, -2.0)
    crack = replace(defect(1, 33.0, -2.0), kind="single_crack", width_m=0.05)
    traffic = trace_of([passing(30.0, 2.0, 3.0, Size(3.77, 1.66, 1.52))], 10.0)
    return SceneState(replace(straight(), defects=(hole, crack)), traffic.agents_at(0.5), ("hatchback",))


def from_above(height_m: float = 10.0) -> View:
    return look(
        (30.0, 0.0, height_m), yaw_rad=0.0, pitch_rad=-np.pi / 2, size_px=(SIZE, SIZE), vertical_fov_rad=np.pi / 2
    )


def seen(moment: SceneState, painted: dict[int, tuple[slice, slice]], alone: dict[int, int], height_m: float = 10.0):
    labels = np.zeros((SIZE, SIZE), dtype=np.uint32)
    for label, where in painted.items():
        labels[where] = label
    frame = RenderedFrame(from_above(height_m), shaded(labels), None, labels, alone, defect_free=shaded(labels, 0.0))
    return {obj.id: obj for obj in labelled_objects(frame, moment)}


def shaded(labels: np.ndarray, darker: float = 60.0) -> np.ndarray:
    """A picture of grainy asphalt (σ 6 grey levels) on which what is labelled is darker."""
    grain = np.random.default_rng(0).normal(0.0, 6.0, labels.shape)
    grey = np.clip(130.0 + grain - darker * (labels > 0), 0, 255)
    return np.repeat(grey.astype(np.uint8)[:, :, None], 3, axis=2)


def test_a_thing_says_what_it_is_and_how_much_of_it_is_seen(moment: SceneState) -> None:
    found = seen(
        moment,
        {POTHOLE: np.s_[96:104, 116:124], AGENT: np.s_[80:118, 70:90]},
        {POTHOLE: 128, AGENT: 38 * 20},
    )
    hole, car = found["defect 0"], found["agent 0"]
    assert (hole.category, hole.box, hole.visible_fraction, hole.truncated, hole.ignored) == (
        "Pothole", (116, 96, 124, 104), 0.5, False, None,
    )  # fmt: skip
    assert hole.position_m == (30.0, -2.0, 0.0)
    assert hole.distance_m == pytest.approx(np.hypot(10.0, 2.0), abs=1e-3)
    assert hole.details["severity"] == moment.world.defects[0].severity.value
    assert hole.details["street"] == moment.world.segments[0].street_name
    assert (car.category, car.visible_fraction, car.details["kind"]) == ("Car", 1.0, "hatchback")
    assert car.details["speed_mps"] == pytest.approx(3.0)
    assert car.details["length_m"] == pytest.approx(3.77, abs=1e-3)


@pytest.mark.parametrize(
    ("label", "where", "alone", "reason"),
    [
        (POTHOLE, np.s_[96:104, 116:124], 64 * 7, Reason.HIDDEN),
        (POTHOLE, np.s_[96:104, 116:124], 64 * 6, None),
        (POTHOLE, np.s_[96:100, 116:121], 20, Reason.SMALL),
        (POTHOLE, np.s_[96:104, 116:118], 16, Reason.SMALL),
        (POTHOLE, np.s_[96:99, 116:126], 30, Reason.SMALL),
        (CRACK, np.s_[96:98, 100:120], 40, None),
        (CRACK, np.s_[96:97, 100:120], 20, Reason.SMALL),
        (CRACK, np.s_[96:98, 100:112], 24, Reason.SMALL),
        (AGENT, np.s_[80:92, 70:76], 72, None),
        (AGENT, np.s_[80:91, 70:80], 110, Reason.SMALL),
    ],
)
def test_what_is_hardly_seen_is_ignored_and_kept(moment: SceneState, label: int, where, alone: int, reason) -> None:
    (obj,) = seen(moment, {label: where}, {label: alone}).values()
    assert obj.ignored == (reason.value if reason else None)
    assert decode(obj.mask, (SIZE, SIZE)).sum() == obj.area_px


@pytest.mark.parametrize(("label", "where"), [(POTHOLE, np.s_[80:120, 110:140]), (CRACK, np.s_[96:98, 60:120])])
def test_what_the_picture_hardly_shows_is_ignored_and_its_contrast_kept(moment: SceneState, label: int, where) -> None:
    labels = np.zeros((SIZE, SIZE), dtype=np.uint32)
    labels[where] = label
    alone, contrasts = {label: int((labels > 0).sum())}, []
    for darker in (0.0, 5.0, 20.0, 60.0):
        pictures = shaded(labels, darker), shaded(labels, 0.0)
        frame = RenderedFrame(from_above(), pictures[0], None, labels, alone, defect_free=pictures[1])
        (obj,) = labelled_objects(frame, moment)
        contrasts.append(obj.details["contrast"])
        if darker in (0.0, 60.0):
            assert obj.ignored == (None if darker else Reason.FAINT.value)
    assert contrasts[0] == 0.0
    assert contrasts == sorted(contrasts)


@pytest.mark.parametrize("alone", [0, 1])
def test_what_is_seen_of_a_speck_is_at_most_all_of_it(moment: SceneState, alone: int) -> None:
    """The pass that draws it without what hides it samples other places, and may miss a pixel that the picture has."""
    (speck,) = seen(moment, {POTHOLE: np.s_[99:100, 116:118]}, {POTHOLE: alone}).values()
    assert (speck.area_px, speck.amodal_px, speck.visible_fraction) == (2, 2, 1.0)


def test_a_contrast_is_that_of_the_defect_alone() -> None:
    """A white line or the edge of a shadow across it, a dark joint or a car beside it are not part of it."""
    labels = np.zeros((SIZE, SIZE), dtype=np.uint32)
    labels[96:98, 60:120] = CRACK
    (crack,) = instance_masks(labels)

    def contrast(change, labels: np.ndarray = labels) -> float:
        with_it, without = (change(shaded(labels == CRACK, darker).astype(float)) for darker in (20.0, 0.0))
        return ContrastMeter(np.uint8(with_it), np.uint8(without), labels).contrast(crack)

    def marked(grey: np.ndarray) -> np.ndarray:
        grey[:, 80:84] += 60
        return grey

    def jointed(grey: np.ndarray) -> np.ndarray:
        grey[94:96] -= 60
        return grey

    wanted = contrast(lambda grey: grey)
    assert contrast(lambda grey: grey * 0.4) == pytest.approx(wanted, rel=0.15)
    assert contrast(marked) == pytest.approx(wanted, rel=0.3)
    assert contrast(jointed) < wanted
    beside = np.where((labels == 0) & (np.arange(SIZE)[:, None] > 98), AGENT, labels)
    assert contrast(lambda grey: grey, beside) == pytest.approx(wanted, rel=0.1)


def test_more_of_the_same_crack_is_seen_better_and_rougher_pavement_hides_it() -> None:
    def contrast(length_px: int, darker: float = 20.0, rougher: float = 1.0) -> float:
        labels = np.zeros((SIZE, SIZE), dtype=np.uint32)
        labels[96:98, 20 : 20 + length_px] = CRACK
        with_it, without = shaded(labels, darker).astype(float), shaded(labels, 0.0).astype(float)
        rough = (without - 130.0) * (rougher - 1.0)
        (crack,) = instance_masks(labels)
        return ContrastMeter(np.uint8(with_it + rough), np.uint8(without + rough), labels).contrast(crack)

    assert contrast(160) / contrast(20) == pytest.approx(8 ** (1 / 3), rel=0.15)
    assert contrast(80, rougher=3.0) == pytest.approx(contrast(80) / 3.0, rel=0.1)


def test_labels_need_the_defect_free_image(moment: SceneState) -> None:
    labels = np.zeros((SIZE, SIZE), dtype=np.uint32)
    with pytest.raises(ValueError, match="defect-free image"):
        labelled_objects(RenderedFrame(from_above(), shaded(labels), None, labels, {}), moment)


def test_what_lies_far_away_is_ignored(moment: SceneState) -> None:
    painted, alone = {POTHOLE: np.s_[90:110, 100:120]}, {POTHOLE: 400}
    assert seen(moment, painted, alone, height_m=28.0)["defect 0"].ignored is None
    assert seen(moment, painted, alone, height_m=31.0)["defect 0"].ignored == Reason.FAR.value


def test_a_share_within_the_image_is_that_of_the_outline() -> None:
    view = from_above()
    square = np.array([(x, y, 0.0) for x, y in [(38, -1), (42, -1), (42, 1), (38, 1)]])
    assert inside_fraction(view, square) == pytest.approx(0.5)
    assert inside_fraction(view, square + (10.0, 0.0, 0.0)) == 0.0
    assert inside_fraction(view, square - (5.0, 0.0, 0.0)) == pytest.approx(1.0)
    assert inside_fraction(view, square + (0.0, 0.0, 11.0)) is None


def test_a_thing_cut_off_by_the_border_is_ignored(moment: SceneState) -> None:
    far_aside = replace(moment.world.defects[0], polygon=shapely.box(39.9, -4.0, 41.9, 0.0))
    world = replace(moment.world, defects=(far_aside, *moment.world.defects[1:]))
    found = seen(replace(moment, world=world), {POTHOLE: np.s_[0:8, 100:140]}, {POTHOLE: 320})
    obj: LabelledObject = found["defect 0"]
    assert (obj.truncated, obj.ignored) == (True, Reason.CUT.value)


def test_what_fills_the_image_is_labelled_though_most_of_it_lies_outside(moment: SceneState) -> None:
    far_aside = replace(moment.world.defects[0], polygon=shapely.box(39.9, -4.0, 41.9, 0.0))
    world = replace(moment.world, defects=(far_aside, *moment.world.defects[1:]))
    (obj,) = seen(replace(moment, world=world), {POTHOLE: np.s_[0:20, 100:140]}, {POTHOLE: 800}).values()
    assert obj.inside_fraction == pytest.approx(0.05)
    assert (obj.truncated, obj.ignored) == (True, None)


def test_the_share_of_a_defect_is_that_of_its_area_on_the_road() -> None:
    """In the image plane what lies below a camera that looks ahead would count for nearly all."""
    ahead = look(
        (0, 0, 1.3), yaw_rad=0.0, pitch_rad=np.radians(-22), size_px=(SIZE, SIZE), vertical_fov_rad=np.radians(58)
    )
    first_m = 1.3 / np.tan(np.radians(22 + 29))
    assert ground_fraction(ahead, shapely.box(first_m - 1, -0.2, first_m + 1, 0.2)) == pytest.approx(0.5, abs=0.01)
    assert ground_fraction(ahead, shapely.box(5, -0.2, 6, 0.2)) == pytest.approx(1.0)


def test_an_agent_who_is_not_there_is_refused(moment: SceneState) -> None:
    with pytest.raises(ValueError, match="agent 7"):
        seen(moment, {agent_label(7): np.s_[0:9, 0:9]}, {agent_label(7): 81})
