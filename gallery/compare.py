"""`python -m gallery.compare PHOTOGRAPHS`: how frames of the twin differ from photographs, in numbers.

Both are brought to 512 × 512. Of every picture: mean lightness and its spread, chroma, and how much detail there is at
one, four and sixteen pixels (standard deviation of the difference between two Gaussian blurs, in lightness). Each is
given as the median and the middle 80 % over the pictures.
"""

import argparse
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageFilter

from gallery.renderer import LOW_SUN, MORNING, OVERCAST, GalleryRenderer, Picture
from pavetwin.cli.console import fail, out
from pavetwin.scene.view import nadir

SIDE_PX: Final = 512
FRAMES: Final = 60
ALTITUDES_M: Final = (6.0, 10.0)
SCALES_PX: Final = (1.0, 4.0, 16.0)

Float = npt.NDArray[np.float64]


def readings(picture: Image.Image) -> Float:
    """Mean L*, its standard deviation, mean chroma, and the detail at `SCALES_PX`, of one picture."""
    lab = np.asarray(picture.resize((SIDE_PX, SIDE_PX), Image.Resampling.LANCZOS).convert("LAB"), dtype=np.float64)
    lightness = lab[..., 0] * 100 / 255
    # Pillow stores a* and b* as signed bytes.
    chroma = np.hypot(*(((lab[..., band] + 128) % 256) - 128 for band in (1, 2)))
    detail = [_band(lightness, scale) for scale in SCALES_PX]
    return np.array([lightness.mean(), lightness.std(), chroma.mean(), *detail])


def _band(lightness: Float, scale_px: float) -> float:
    image = Image.fromarray(lightness.astype(np.float32) * 2.55).convert("L")
    fine, coarse = (
        np.asarray(image.filter(ImageFilter.GaussianBlur(scale)), dtype=np.float64)
        for scale in (scale_px / 2, scale_px)
    )
    return float((fine - coarse).std() / 2.55)


def frames(renderer: GalleryRenderer, take: Callable[..., Picture]) -> Iterable[Image.Image]:
    """Frames of empty streets over evenly chosen defects, from two altitudes, under three skies."""
    defects = renderer.world.defects[:: max(1, len(renderer.world.defects) // FRAMES)][:FRAMES]
    for index, defect in enumerate(defects):
        place = (defect.centre.x, defect.centre.y, ALTITUDES_M[index % 2])
        view = nadir(renderer.camera, place, yaw_rad=0.7 * index, size_px=(SIDE_PX, SIDE_PX))
        yield Image.fromarray(take(view, (MORNING, LOW_SUN, OVERCAST)[index % 3]))


def main() -> int:
    """Print both sides' readings beside each other."""
    parser = argparse.ArgumentParser(prog="python -m gallery.compare", description=__doc__)
    parser.add_argument("photographs", type=Path, help="folder of photographs of roads from above")
    parser.add_argument("--work", type=Path, default=Path("out/gallery"), help="folder of the town")
    options = parser.parse_args()
    found = sorted(path for path in options.photographs.rglob("*") if path.suffix.lower() in (".jpg", ".jpeg", ".png"))
    if not found:
        fail(f"'{options.photographs}' holds no JPEG or PNG.")
        return 2
    chosen = found[:: max(1, len(found) // (4 * FRAMES))]
    real = np.array([readings(Image.open(path).convert("RGB")) for path in chosen])
    renderer = GalleryRenderer(options.work)
    ours = np.array([readings(frame) for frame in frames(renderer, renderer.take)])
    names = ["lightness L*", "spread of L*", "chroma", *(f"detail at {scale:g} px" for scale in SCALES_PX)]
    out.print(f"{len(real)} photographs, {len(ours)} frames: median (10 % … 90 %)")
    for index, name in enumerate(names):
        low, middle, high = np.quantile(real[:, index], (0.1, 0.5, 0.9))
        low_o, middle_o, high_o = np.quantile(ours[:, index], (0.1, 0.5, 0.9))
        out.print(
            f"{name:16} photographs {middle:5.1f} ({low:5.1f} … {high:5.1f})   "
            f"frames {middle_o:5.1f} ({low_o:5.1f} … {high_o:5.1f})"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
