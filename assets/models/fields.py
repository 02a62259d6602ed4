"""Functions that implicit bodies and the pictures on them are made of."""

from collections.abc import Sequence

import numpy as np

from assets.models.common import Floats


def smooth_max(a: Floats, b: Floats, radius: float) -> Floats:
    """The larger of two, rounded over a difference of `radius` (Quílez's polynomial): intersects bodies."""
    h = np.maximum(radius - np.abs(a - b), 0.0) / radius
    return np.maximum(a, b) + h * h * radius / 4.0


def smooth_min(a: Floats, b: Floats, radius: float) -> Floats:
    """The smaller of two, rounded: joins bodies."""
    return -smooth_max(-a, -b, radius)


def curve(knots: Sequence[tuple[float, float]], at: Floats) -> Floats:
    """A smooth curve through knots (position, value), positions rising: a monotone cubic (Fritsch and Butland, 1984).

    Beyond the ends it goes on with the slope it has there.
    """
    x, y = np.array(knots, dtype=np.float64).T
    h, slope = np.diff(x), np.diff(y) / np.diff(x)
    tangent = np.empty(len(x))
    tangent[0], tangent[-1] = slope[0], slope[-1]
    same = slope[:-1] * slope[1:] > 0.0
    weight = 2.0 * h[1:] + h[:-1], h[1:] + 2.0 * h[:-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        inner = (weight[0] + weight[1]) / (weight[0] / slope[:-1] + weight[1] / slope[1:])
    tangent[1:-1] = np.where(same, inner, 0.0)
    k = np.clip(np.searchsorted(x, at) - 1, 0, len(h) - 1)
    t = np.clip((at - x[k]) / h[k], 0.0, 1.0)
    value = (
        (1 + 2 * t) * (1 - t) ** 2 * y[k]
        + t * (1 - t) ** 2 * h[k] * tangent[k]
        + t * t * (3 - 2 * t) * y[k + 1]
        + t * t * (t - 1) * h[k] * tangent[k + 1]
    )
    below, above = np.minimum(at - x[0], 0.0), np.maximum(at - x[-1], 0.0)
    return np.asarray(value + below * tangent[0] + above * tangent[-1])


def rounded(corners: Sequence[Sequence[float]], radius: float, steps: int = 5) -> Floats:
    """A closed outline (n, 2) with its corners rounded. A corner may name its own radius as a third number."""
    points = [np.array(corner[:2], dtype=np.float64) for corner in corners]
    out: list[Floats] = []
    for i, corner in enumerate(corners):
        here, before, after = points[i], points[i - 1], points[(i + 1) % len(points)]
        u, v = before - here, after - here
        lengths = float(np.linalg.norm(u)), float(np.linalg.norm(v))
        u, v = u / lengths[0], v / lengths[1]
        half = np.arccos(np.clip(float(u @ v), -1.0, 1.0)) / 2.0
        wanted = float(corner[2]) if len(corner) > 2 else radius
        reach = min(wanted / max(np.tan(half), 1e-6), 0.48 * lengths[0], 0.48 * lengths[1])
        if half > 1.5 or reach < 1e-4:
            out.append(here)
            continue
        t = np.linspace(0.0, 1.0, steps + 1)[:, None]
        start, end = here + reach * u, here + reach * v
        out.extend((1 - t) ** 2 * start + 2 * t * (1 - t) * here + t * t * end)
    return np.array(out)


def polygon_distance(outline: Floats, a: Floats, b: Floats) -> Floats:
    """The signed distance (n,) of points (a, b) to a closed outline (m, 2), negative inside."""
    start, end = outline, np.roll(outline, -1, axis=0)
    side = end - start
    length = np.maximum((side**2).sum(axis=1), 1e-18)
    from_a, from_b = a[:, None] - start[:, 0], b[:, None] - start[:, 1]
    t = np.clip((from_a * side[:, 0] + from_b * side[:, 1]) / length, 0.0, 1.0)
    nearest = np.sqrt(((from_a - t * side[:, 0]) ** 2 + (from_b - t * side[:, 1]) ** 2).min(axis=1))
    above = (start[:, 1] > b[:, None]) != (end[:, 1] > b[:, None])
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = start[:, 0] + (b[:, None] - start[:, 1]) / (end - start)[:, 1] * side[:, 0]
    inside = (above & (a[:, None] < crossing)).sum(axis=1) % 2 == 1
    return np.asarray(np.where(inside, -nearest, nearest))
