"""What a camera stores of light, and textures."""

from pavetwin.arrays import Float32Array, Float64Array, UInt8Array, UInt16Array, UInt32Array

def texture_sample(levels: list[Float32Array], uv: Float64Array, level: Float32Array, wraps: bool) -> Float32Array:
    """(n, c) values at (n, 2) texture coordinates and (n,) levels, trilinear.

    Args:
        levels: (k, k, c) each, halved from one to the next; row 0 at v = 0, texel centres at (i + ½) / k.
        uv: 0 … 1 over the texture.
        level: 0 for the first.
        wraps: it repeats; else its edge texels go on outwards.
    """

def expose(
    light: UInt16Array,
    *,
    seed: int,
    electrons_per_light: float,
    full_electrons: float,
    read_electrons: float,
    vignetting: float,
    blur_px: float,
    white_balance: tuple[float, float, float],
    saturation: float,
    sharpening: float,
    curve: Float32Array,
    mosaic: tuple[float, int] | None = None,
    depth: Float32Array | None = None,
    labels: UInt32Array | None = None,
    focal_px: float = 1.0,
    frame_px: tuple[int, int] | None = None,
    corner_px: tuple[int, int] = (0, 0),
    still_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    moving_m: dict[int, tuple[float, float, float]] = {},
) -> UInt8Array:
    """What a camera stores, (height, width, 3) sRGB, of light (height, width, 4), half floats in kcd/m² seen as uint16.

    Args:
        light: red, green, blue, and one that is not read.
        seed: of the noise.
        electrons_per_light: of one pixel for each kcd/m², over the exposure.
        full_electrons: at which a pixel is full, at the ISO in use.
        read_electrons: standard deviation of the electronics.
        vignetting: share of the light that is missing in the corners.
        blur_px: standard deviation of the lens's point spread.
        white_balance: gains of red, green and blue.
        saturation: distance of colours from grey, 1 as they are.
        sharpening: how much of the difference to its neighbours is added to a pixel.
        curve: (n,) output 0 … 1 at inputs (i / (n − 1))².
        mosaic: where a pixel is one of the sensor, how many standard deviations of the noise its reduction takes for
            noise, and over how many pixels around it takes the mean of colours (0 to 2); None where a pixel is the mean
            of many.
        depth: (height, width) metres along the axis; None for no motion.
        labels: (height, width), to tell what moves by itself.
        focal_px: focal length.
        still_m: what stands still moves this in the camera's frame (right, down, forward) over the exposure, metres.
        moving_m: likewise of labelled things that move.
    """
