"""Synthetic images made to look like photographs: what changes, what must not, and that only synthetic ones do."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageFilter

from pavetwin.errors import PaveTwinError
from pavetwin.training.datasets.examples import Example, ExampleSet, read_coco
from pavetwin.training.datasets.unlabelled import read_unlabelled
from pavetwin.training.trainer import references
from pavetwin.training.trainer.amplitude import exchanged, half_block, low_frequencies, with_amplitudes
from pavetwin.training.trainer.appearance import _noise_and_power as noise_and_power
from pavetwin.training.trainer.appearance import appearance_of, blur_between, moved_to
from pavetwin.training.trainer.augment import ViewOptions, random_view
from pavetwin.training.trainer.options import TrainingOptions
from pavetwin.training.trainer.references import photometrics
from pavetwin.training.trainer.views import LabelledView
from scenes.drawn_roads import drawn_roads


def picture(
    seed: int, size: tuple[int, int] = (96, 64), *, colour: tuple[int, int, int] = (120, 110, 100)
) -> np.ndarray:
    """A road with rough texture, brighter to one side."""
    rng = np.random.default_rng(seed)
    width, height = size
    coarse = Image.fromarray(rng.integers(0, 255, (height // 4, width // 4), dtype=np.uint8))
    texture = np.asarray(coarse.resize(size, Image.Resampling.BICUBIC), dtype=np.float64)[..., None]
    slope = np.linspace(-20, 20, width)[None, :, None]
    return np.clip(
        np.array(colour) + slope + 0.3 * (texture - 128) + rng.normal(0, 2, (height, width, 1)), 0, 255
    ).astype(np.uint8)


def detailed(seed: int) -> np.ndarray:
    """Of 160 × 128 px, with details of two pixels."""
    return np.asarray(Image.fromarray(picture(seed, (320, 256))).resize((160, 128), Image.Resampling.BOX))


def published(pixels: np.ndarray, photograph: np.ndarray, beta: float) -> np.ndarray:
    """The transfer as its authors publish it, by whole transforms of two images of one size."""
    source, target = (np.fft.fft2(each.astype(float), axes=(0, 1)) for each in (pixels, photograph))
    own = np.fft.fftshift(np.abs(source), axes=(0, 1))
    other = np.fft.fftshift(np.abs(target), axes=(0, 1))
    height, width = pixels.shape[:2]
    half, row, column = int(min(height, width) * beta), height // 2, width // 2
    block = np.s_[row - half : row + half + 1, column - half : column + half + 1]
    own[block] = other[block]
    return np.fft.ifft2(np.fft.ifftshift(own, axes=(0, 1)) * np.exp(1j * np.angle(source)), axes=(0, 1)).real


def amplitudes(pixels: np.ndarray, beta: float) -> np.ndarray:
    return np.abs(low_frequencies(pixels, half_block(pixels.shape[:2], beta)))


@pytest.mark.parametrize("beta", [0.01, 0.05, 0.2])
def test_the_transfer_is_the_published_one(beta: float) -> None:
    one, other = picture(1), picture(2, colour=(180, 170, 140))
    found = exchanged(one, amplitudes(other, beta), beta)
    assert found == pytest.approx(published(one, other, beta), abs=1e-6)
    assert np.abs(found - one).mean() > 10


def test_an_image_with_its_own_amplitudes_is_itself() -> None:
    one = picture(1)
    assert np.array_equal(with_amplitudes(one, amplitudes(one, 0.2), 0.2), one)


def test_phases_stay_and_only_low_frequencies_change() -> None:
    """Up to 6 cycles an image, of 64 rows at β 0.1."""
    one = picture(1)
    found = exchanged(one, amplitudes(picture(2, colour=(180, 170, 140)), 0.1), 0.1)
    before, after = (np.fft.fft2(each, axes=(0, 1)) for each in (one.astype(float), found))
    turned = np.angle(after / before)[np.abs(before) > 1]
    assert np.abs(turned).max() < 1e-6
    moved = np.abs(after - before).max(axis=2) > 1e-3
    down, across = np.meshgrid(np.fft.fftfreq(64, 1 / 64), np.fft.fftfreq(96, 1 / 96), indexing="ij")
    assert not moved[np.maximum(abs(down), abs(across)) > 6].any()
    assert moved[0, 0]
    assert moved[6, 6]


def test_amplitudes_hold_for_images_of_other_sizes_and_slivers_are_left() -> None:
    """Twice the photograph, scaled, gives what the photograph gives."""
    one, photograph = picture(1), picture(2, colour=(180, 170, 140))
    large = np.asarray(Image.fromarray(photograph).resize((384, 256), Image.Resampling.BICUBIC))
    few = [with_amplitudes(one, amplitudes(each, 0.05)[..., :], 0.05).astype(float) for each in (photograph, large)]
    assert np.abs(few[0] - few[1]).mean() < 1.5
    sliver = one[:5]
    assert np.array_equal(with_amplitudes(sliver, amplitudes(photograph, 0.05), 0.05), sliver)


@pytest.mark.parametrize("sigma", [0.5, 1.0, 1.6])
def test_a_blur_is_found_from_the_sharpness(sigma: float) -> None:
    whole = detailed(3)
    blurred = np.asarray(Image.fromarray(whole).filter(ImageFilter.GaussianBlur(sigma)))
    _, power = noise_and_power(whole)
    assert blur_between(power, appearance_of(blurred).sharpness) == pytest.approx(sigma, abs=0.25)
    assert blur_between(noise_and_power(blurred)[1], appearance_of(whole).sharpness) == 0.0


@pytest.mark.parametrize("sigma", [4.0, 10.0])
def test_noise_is_told_from_texture(sigma: float) -> None:
    smooth = Image.fromarray(picture(3, (320, 256))).filter(ImageFilter.GaussianBlur(2))
    noise = np.random.default_rng(0).normal(0, sigma, (256, 320))
    noisy = np.clip(np.asarray(smooth) + noise[..., None], 0, 255).astype(np.uint8)
    assert appearance_of(np.asarray(smooth)).noise < 1
    assert appearance_of(noisy).noise == pytest.approx(sigma, rel=0.1)


def test_a_picture_moved_to_another_looks_like_it() -> None:
    sharp = detailed(3)
    dull = Image.fromarray(detailed(4) // 2 + 100).filter(ImageFilter.GaussianBlur(0.8))
    noise = np.random.default_rng(0).normal(0, 3, (128, 160))[..., None]
    goal = appearance_of(np.clip(np.asarray(dull) + noise, 0, 255).astype(np.uint8))
    before, found = appearance_of(sharp), appearance_of(moved_to(sharp, goal, np.random.default_rng(1)))
    assert before.sharpness > 3 * goal.sharpness
    assert found.mean == pytest.approx(goal.mean, abs=1)
    assert found.spread == pytest.approx(goal.spread, rel=0.1)
    assert found.noise == pytest.approx(goal.noise, rel=0.15)
    assert found.sharpness == pytest.approx(goal.sharpness, rel=0.5)


def test_a_picture_moved_to_itself_stays_and_is_never_sharpened() -> None:
    one = picture(3, (320, 256))
    assert np.abs(moved_to(one, appearance_of(one), np.random.default_rng(0)).astype(int) - one).max() <= 1
    dull = np.asarray(Image.fromarray(one).filter(ImageFilter.GaussianBlur(1.5)))
    goal = replace(appearance_of(one), noise=0.0)
    found = moved_to(dull, goal, np.random.default_rng(0))
    assert appearance_of(found).sharpness == pytest.approx(appearance_of(dull).sharpness, rel=0.3)


def test_grey_things_get_one_tint_and_no_colours_of_their_own() -> None:
    """Of a photograph whose blue varies four times as much as its red."""
    coloured = picture(4, (320, 256)).astype(float)
    coloured = np.uint8((coloured - coloured.mean(axis=(0, 1))) * [0.5, 1.0, 2.0] + [120, 130, 140])
    grey = np.repeat(detailed(3)[..., :1], 3, axis=2)
    found = moved_to(grey, appearance_of(coloured), np.random.default_rng(0)).astype(float)
    assert found.mean(axis=(0, 1)) == pytest.approx([120, 130, 140], abs=1)
    assert (found[..., 2] - found[..., 0]).std() < 1


@pytest.mark.parametrize("size", [(20, 8), (3, 200), (1, 1)])
def test_the_smallest_parts_of_mosaics_are_moved_too(size: tuple[int, int]) -> None:
    pixels = np.full((size[1], size[0], 3), 50, dtype=np.uint8)
    found = moved_to(pixels, appearance_of(picture(1)), np.random.default_rng(0))
    assert found.shape == pixels.shape
    assert found.mean(axis=(0, 1)) == pytest.approx(picture(1).mean(axis=(0, 1)), abs=2)


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("photographs")
    (folder / "within").mkdir()
    for at, name in enumerate(("a.jpg", "within/b.png")):
        Image.fromarray(picture(10 + at, (192, 144), colour=(200, 180 + 20 * at, 90))).save(folder / name)
    return folder


@pytest.fixture(scope="module")
def sets(tmp_path_factory: pytest.TempPathFactory) -> tuple[ExampleSet, ExampleSet]:
    """Synthetic images, and photographs with labels."""
    folder = tmp_path_factory.mktemp("sets")
    synthetic = drawn_roads(folder / "synthetic", {"train": 4}, synthetic=True)
    return read_coco(synthetic, ("train",)), read_coco(drawn_roads(folder / "real", {"train": 4}, seed=7), ("train",))


SWITCHES = {"fourier": 0.05, "appearance": 1.0}


def shown(data: ExampleSet, photographs: Path, mosaic: float, others: ExampleSet, **switches: float) -> LabelledView:
    options = TrainingOptions(image_px=128, **switches)
    changes = photometrics(read_unlabelled(photographs), options) if switches else ()
    members = [(each, example) for each in (data, others) for example in each.examples]
    return random_view(members[0], members, options.views(mosaic=bool(mosaic)), np.random.default_rng(5), changes)


@pytest.mark.parametrize("name", SWITCHES)
def test_synthetic_images_change_and_their_labels_do_not(
    sets: tuple[ExampleSet, ExampleSet], photographs: Path, name: str
) -> None:
    synthetic, real = sets
    plain = shown(synthetic, photographs, 0, synthetic)
    changed = shown(synthetic, photographs, 0, synthetic, **{name: SWITCHES[name]})
    assert changed.objects == plain.objects
    assert np.abs(changed.pixels.astype(int) - plain.pixels).mean() > 5
    again = shown(synthetic, photographs, 0, synthetic, **{name: SWITCHES[name]})
    assert np.array_equal(again.pixels, changed.pixels)
    assert np.array_equal(
        shown(real, photographs, 0, real, **{name: SWITCHES[name]}).pixels, shown(real, photographs, 0, real).pixels
    )


def test_in_a_mosaic_of_both_only_the_synthetic_parts_change(
    sets: tuple[ExampleSet, ExampleSet], photographs: Path
) -> None:
    synthetic, real = sets
    plain, changed = (shown(synthetic, photographs, 1, real, **on) for on in ({}, SWITCHES))
    assert plain.labels.sources == {"drawn roads", "PaveTwin synthetic images"}
    moved = (plain.pixels != changed.pixels).any(axis=2)
    for each in plain.objects:
        left, top, right, bottom = (round(side) for side in each.box)
        share = moved[top:bottom, left:right].mean()
        assert share == 0 if not each.part.example.is_synthetic else share > 0.5


def test_a_photograph_is_measured_once(photographs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []
    of = ExampleSet.picture

    def counted(self: ExampleSet, example: Example) -> Image.Image:
        read.append(example.name)
        return of(self, example)

    changes = photometrics(read_unlabelled(photographs), TrainingOptions(image_px=128, **SWITCHES))
    monkeypatch.setattr(ExampleSet, "picture", counted)
    rng = np.random.default_rng(0)
    pixels = picture(1)
    for _ in range(20):
        for change in changes:
            pixels = change(picture(1), rng)
    assert sorted(read) == sorted(2 * ["a.jpg", "within/b.png"])
    assert pixels.shape == (64, 96, 3)


@pytest.mark.parametrize("native", [False, True])
def test_photographs_are_measured_at_the_resolution_of_views(photographs: Path, native: bool) -> None:
    """192 × 144 in views of 64: all of it at a third, or its middle as it is."""
    options = TrainingOptions(image_px=64, native=native, fourier=0.1)
    held = references.References(read_unlabelled(photographs), options, lambda pixels: pixels)
    found = held.draw(np.random.default_rng(1))
    assert found.shape == ((64, 64, 3) if native else (48, 64, 3))
    if native:
        whole = [np.asarray(Image.open(photographs / name)) for name in ("a.jpg", "within/b.png")]
        assert any(np.array_equal(found, each[40:104, 64:128]) for each in whole)


def test_of_a_dataset_the_photographs_of_the_training_split_are_taken_without_labels(tmp_path: Path) -> None:
    data = read_unlabelled(drawn_roads(tmp_path / "real", {"train": 3, "val": 2, "test": 2}))
    assert [(each.split, each.objects) for each in data.examples] == 3 * [("train", ())]
    with pytest.raises(PaveTwinError, match="holds no photograph; it is a folder of pictures"):
        read_unlabelled(drawn_roads(tmp_path / "synthetic", {"train": 1}, synthetic=True))


def test_a_folder_that_cannot_be_read_is_refused(tmp_path: Path, photographs: Path) -> None:
    for path, told in (
        (tmp_path / "nosuch", r"`photographs`: there is no folder '.*nosuch'"),
        (tmp_path, "`photographs`: '.*' holds no photograph"),
    ):
        with pytest.raises(PaveTwinError, match=told):
            read_unlabelled(path)
    (tmp_path / "text.jpg").write_text("no picture")
    with pytest.raises(PaveTwinError, match=r"`photographs`: '.*text.jpg' cannot be read as an image"):
        read_unlabelled(tmp_path)
    one, other = (read_unlabelled(photographs).fingerprint for _ in range(2))
    assert one == other


def test_views_without_a_switch_draw_the_same_random_numbers(sets: tuple[ExampleSet, ExampleSet]) -> None:
    """Where nothing is changed, the stream of random numbers is where it would be without the code."""
    members = [(sets[0], each) for each in sets[0].examples]
    after = []
    for changes in ((), (lambda pixels, rng: pixels + np.uint8(rng.integers(1)),)):
        rng = np.random.default_rng(3)
        random_view(members[0], members, ViewOptions(size_px=64), rng, changes)
        after.append(rng.random())
    assert after[0] == after[1]
