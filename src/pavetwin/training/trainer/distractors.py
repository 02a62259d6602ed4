"""Random shapes with random textures, painted where nothing is labelled (domain randomisation; Tremblay et al. 2018,
"Training Deep Networks with Synthetic Data: Bridging the Reality Gap by Domain Randomization", call them flying
distractors).

Most of what a detector that has seen no photograph finds wrongly on photographs lies beside the road, or on it without
being damage: pavers, leaves, grass, stains, patches, manholes. No scene has all of these. What is painted here looks
like none of them and has something of each, so that a texture or an edge alone is no longer taken for damage.

All is drawn on the device that trains. Numbers that say what is drawn come from the seed, so a run goes on to the same
curve; the noise is that of the device's own generator, from the seed too.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import max_pool2d

from pavetwin.arrays import AnyArray
from pavetwin.training.trainer.targets import Targets

SHAPES: Final = ("half-plane", "strip", "ellipse", "rectangle", "ring")
SHAPE_SHARES: Final = (0.25, 0.2, 0.2, 0.2, 0.15)
"""A half-plane is what lies beyond a kerb; a strip a kerb, a joint or a marking; a ring the rim of a manhole."""

TEXTURES: Final = ("noise", "blotches", "grid", "stain")
TEXTURE_SHARES: Final = (0.3, 0.25, 0.2, 0.25)
"""Soil and grass; leaves; pavers; and what only darkens or brightens the ground."""

CELL_PX: Final = 8
"""Side of the cells in which shapes and labelled boxes are compared."""

SEEN: Final = 0.02
"""Opacity from which a shape covers a pixel; where it would cover less, it ends."""

_PI: Final = float(np.pi)


@dataclass(frozen=True, slots=True)
class _Layer:
    """One shape for each image: rows of random numbers, (batch,) or (batch, …) float32."""

    shape: Tensor
    """Number in `SHAPES`."""
    centre: Tensor
    """(batch, 2) as shares of the sides."""
    angle: Tensor
    """Radians."""
    half: Tensor
    """(batch, 2) half sides, as shares of the image's."""
    rough: Tensor
    """How far the outline strays, as a share of the side."""
    soft: Tensor
    """Width over which the shape ends, as a share of the side."""
    opacity: Tensor
    """Of its middle, 0 … 1."""
    texture: Tensor
    """Number in `TEXTURES`."""
    slope: Tensor
    """β of the noise, whose amplitudes fall as frequency to the power −β."""
    colour: Tensor
    """(batch, 3) mean."""
    swing: Tensor
    """(batch, 3) colour of one standard deviation of the texture."""
    gain: Tensor
    """Of a stain: what the ground's colours are multiplied by."""
    period: Tensor
    """Of the grid, as a share of the side."""
    joint: Tensor
    """Share of the grid's period that its joints take."""
    offset: Tensor
    """By how much each second row of the grid is moved, as a share of its period."""


def with_distractors(images: Tensor, targets: Targets, count: int, rng: np.random.Generator) -> Tensor:
    """Images with up to `count` shapes each; labelled boxes, also those that are ignored, stay as they are.

    Args:
        images: (batch, 3, height, width) in 0 … 1, square.
        targets: what is labelled in them, on the same device.
        count: shapes that are drawn for each image; one that would touch a labelled box is left out.
        rng: decides everything.
    """
    device = images.device
    noise = torch.Generator(device).manual_seed(int(rng.integers(2**62)))
    labelled = _labelled_cells(images, targets)
    for _ in range(count):
        layer = _random_layer(len(images), rng, device)
        first, second = _noise(images, layer.slope, noise), _noise(images, torch.full_like(layer.slope, 1.5), noise)
        cover = _cover(layer, second, images.shape[-1])
        is_seen = cover > SEEN
        touched = max_pool2d(is_seen.float()[:, None], CELL_PX, ceil_mode=True) * labelled
        is_kept = (touched.amax(dim=(1, 2, 3)) == 0)[:, None, None]
        images = torch.lerp(images, _painted(images, layer, first).clamp(0, 1), (cover * is_seen * is_kept)[:, None])
    return images


def _random_layer(count: int, rng: np.random.Generator, device: torch.device) -> _Layer:
    """A shape for each of `count` images."""

    def uniform(low: float, high: float, *more: int) -> Tensor:
        return _on(rng.uniform(low, high, (count, *more)), device)

    def log_uniform(low: float, high: float, *more: int) -> Tensor:
        return uniform(float(np.log(low)), float(np.log(high)), *more).exp()

    grey = uniform(0.1, 0.9, 1)
    tint = uniform(-0.3, 0.3, 3) * uniform(0, 1, 1)
    return _Layer(
        shape=_on(rng.choice(len(SHAPES), count, p=SHAPE_SHARES), device),
        centre=uniform(0, 1, 2),
        angle=uniform(0, 2 * _PI),
        half=log_uniform(0.015, 0.3, 2),
        rough=log_uniform(0.001, 0.06) * _on(rng.random(count) < 0.6, device),
        soft=log_uniform(0.002, 0.08),
        opacity=uniform(0.5, 1),
        texture=_on(rng.choice(len(TEXTURES), count, p=TEXTURE_SHARES), device),
        slope=uniform(0, 1.4),
        colour=(grey + tint).clamp(0, 1),
        swing=log_uniform(0.02, 0.25, 1) * (1 + uniform(-0.5, 0.5, 3)),
        gain=log_uniform(0.35, 1.6),
        period=log_uniform(0.02, 0.25),
        joint=log_uniform(0.03, 0.2),
        offset=_on(rng.choice([0.0, 0.5], count), device),
    )


def _on(values: AnyArray, device: torch.device) -> Tensor:
    return torch.from_numpy(values.astype(np.float32)).to(device, non_blocking=True)


def _labelled_cells(images: Tensor, targets: Targets) -> Tensor:
    """(batch, 1, rows, columns) float32: 1 for the cells of `CELL_PX` that a labelled box touches."""
    rows, columns = (-(-side // CELL_PX) for side in images.shape[-2:])
    boxes = targets.boxes / CELL_PX

    def within(low: Tensor, high: Tensor, cells: int) -> Tensor:
        at = torch.arange(cells, device=images.device)
        return (at >= low.floor()[:, None]) & (at < high.ceil()[:, None])

    down, across = within(boxes[:, 1], boxes[:, 3], rows), within(boxes[:, 0], boxes[:, 2], columns)
    cells = torch.zeros(len(images), rows, columns, device=images.device)
    cells.index_add_(0, targets.images, (down[:, :, None] & across[:, None, :]).float())
    return cells.clamp(max=1)[:, None]


def _noise(images: Tensor, slope: Tensor, generator: torch.Generator) -> Tensor:
    """(batch, height, width) of mean 0 and standard deviation 1, with amplitudes that fall by each image's slope."""
    height, width = images.shape[-2:]
    down = torch.fft.fftfreq(height, device=images.device)[:, None]
    across = torch.fft.rfftfreq(width, device=images.device)[None]
    frequency = torch.hypot(down, across).clamp(min=1 / max(height, width))
    white = torch.randn(len(images), height, width, generator=generator, device=images.device)
    shaped = torch.fft.irfft2(torch.fft.rfft2(white) * frequency ** -slope[:, None, None], s=(height, width))
    mean, spread = shaped.mean(dim=(1, 2), keepdim=True), shaped.std(dim=(1, 2), keepdim=True)
    return (shaped - mean) / spread.clamp(min=1e-6)


def _turned(layer: _Layer, side: int) -> tuple[Tensor, Tensor]:
    """(batch, side, side) each: places along and across the shape, from its centre, as shares of the side."""
    at = (torch.arange(side, device=layer.angle.device) + 0.5) / side
    x = at[None, None, :] - layer.centre[:, 0, None, None]
    y = at[None, :, None] - layer.centre[:, 1, None, None]
    cosine, sine = layer.angle.cos()[:, None, None], layer.angle.sin()[:, None, None]
    return cosine * x + sine * y, cosine * y - sine * x


def _cover(layer: _Layer, outline: Tensor, side: int) -> Tensor:
    """(batch, side, side) opacity of the shapes.

    Args:
        outline: noise by which the outline strays.
    """
    along, across = _turned(layer, side)
    long, short = (each[:, None, None] for each in layer.half.unbind(dim=1))
    thin = 0.25 * torch.minimum(long, short)
    radius = torch.hypot(along / long, across / short)
    inside = (
        along,
        thin - along.abs(),
        (1 - radius) * torch.minimum(long, short),
        torch.minimum(long - along.abs(), short - across.abs()),
        thin - (torch.hypot(along, across) - long).abs(),
    )
    which = layer.shape[:, None, None]
    distance = sum((which == at) * each for at, each in enumerate(inside)) + layer.rough[:, None, None] * outline
    return torch.sigmoid(4 * distance / layer.soft[:, None, None]) * layer.opacity[:, None, None]


def _painted(images: Tensor, layer: _Layer, noise: Tensor) -> Tensor:
    """(batch, 3, side, side): what the shapes would look like if they filled the images.

    Args:
        noise: (batch, side, side) of mean 0 and standard deviation 1.
    """
    along, across = _turned(layer, images.shape[-1])
    period = layer.period[:, None, None]
    row = torch.floor(across / period)
    column = along / period + layer.offset[:, None, None] * row
    joints = torch.maximum(_from_middle(across / period), _from_middle(column)) > 1 - layer.joint[:, None, None]
    # A shade from −1 to 1 for each paver: a hash of its row and column.
    shade = torch.frac(torch.sin(row * 12.9898 + torch.floor(column) * 78.233) * 43758.5453).abs() * 2 - 1
    fields = (noise, torch.tanh(4 * noise), torch.where(joints, torch.full_like(shade, -2.5), shade + 0.3 * noise))
    which = layer.texture[:, None, None]
    field = sum((which == at) * each for at, each in enumerate(fields))
    paint = layer.colour[:, :, None, None] + layer.swing[:, :, None, None] * field[:, None]
    stained = images * layer.gain[:, None, None, None]
    return torch.where(which[:, None] == TEXTURES.index("stain"), stained, paint)


def _from_middle(places: Tensor) -> Tensor:
    """0 in the middle of each whole number's cell, 1 at its edges."""
    return (torch.frac(places) - torch.where(places < 0, -0.5, 0.5)).abs() * 2
