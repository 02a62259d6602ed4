"""Thins a cut skin: takes vertices out where neither the surface nor an outline needs them."""

from typing import Final

import numpy as np

from assets.models.common import Floats
from assets.models.implicit import Skin

WELD_M: Final = 0.0005


def simplify(skin: Skin, tolerance_m: float, longest_m: float = 0.5) -> None:
    """Pulls vertices into a neighbour while the surface stays within `tolerance_m` of f = 0 and of the outlines."""
    _weld(skin)
    mesh = _Mesh(skin, tolerance_m, longest_m)
    for _ in range(3):
        if not mesh.sweep():
            break
    mesh.write_back()


def _weld(skin: Skin) -> None:
    """Makes vertices within half a millimetre one, so that no sliver stands in the way."""
    _, first, place = np.unique(np.round(skin.vertices / WELD_M), axis=0, return_index=True, return_inverse=True)
    skin.triangles = first[place.reshape(-1)[skin.triangles]]
    a, b, c = skin.triangles.T
    skin.keep((a != b) & (b != c) & (c != a))


class _Mesh:
    def __init__(self, skin: Skin, tolerance: float, longest: float) -> None:
        self.skin, self.tolerance, self.longest = skin, tolerance, longest
        self.points, self.normals = skin.vertices, skin.normals()
        self.faces: dict[int, tuple[int, int, int]] = {
            i: (a, b, c) for i, (a, b, c) in enumerate(skin.triangles.tolist())
        }
        self.labels: list[int] = skin.labels.tolist()
        self.around: list[set[int]] = [set() for _ in self.points]
        for index, face in self.faces.items():
            for corner in face:
                self.around[corner].add(index)

    def sweep(self) -> int:
        """One pass over the vertices, the ones with the shortest edges first. Returns how many went."""
        sides = self.skin.triangles if not hasattr(self, "swept") else np.array(list(self.faces.values()))
        self.swept = True
        length = np.full(len(self.points), np.inf)
        for i, j in ((0, 1), (1, 2), (2, 0)):
            edge = np.linalg.norm(self.points[sides[:, i]] - self.points[sides[:, j]], axis=1)
            np.minimum.at(length, sides[:, i], edge)
            np.minimum.at(length, sides[:, j], edge)
        order = np.argsort(length, kind="stable")
        return sum(self._take_out(int(vertex)) for vertex in order if np.isfinite(length[vertex]))

    def _take_out(self, vertex: int) -> bool:
        fan = self.around[vertex]
        if not fan:
            return False
        neighbours, rims = self._ring(vertex)
        if len(rims) not in (0, 2):
            return False
        targets = rims if rims else neighbours
        if rims and not self._straight(vertex, rims):
            return False
        here = self.points[vertex]
        for target in sorted(targets, key=lambda other: float(((self.points[other] - here) ** 2).sum())):
            if self._fits(vertex, target, neighbours):
                self._pull(vertex, target)
                return True
        return False

    def _ring(self, vertex: int) -> tuple[list[int], list[int]]:
        """The neighbours, and those of them along an outline: where the label changes or the mesh ends."""
        seen: dict[int, list[int]] = {}
        for index in sorted(self.around[vertex]):
            for corner in self.faces[index]:
                if corner != vertex:
                    seen.setdefault(corner, []).append(self.labels[index])
        rims = [other for other, labels in seen.items() if len(labels) != 2 or labels[0] != labels[1]]
        return list(seen), rims

    def _straight(self, vertex: int, rims: list[int]) -> bool:
        start, end = self.points[rims[0]], self.points[rims[1]]
        side, away = end - start, self.points[vertex] - start
        length = float(np.linalg.norm(side))
        return length > 1e-9 and float(np.linalg.norm(np.cross(side, away))) / length < 0.6 * self.tolerance

    def _fits(self, vertex: int, target: int, neighbours: list[int]) -> bool:
        shared = set(neighbours) & set(self._ring(target)[0])
        between = self.around[vertex] & self.around[target]
        if len(shared) != len(between):
            return False
        kept = [self.faces[index] for index in self.around[vertex] - between]
        if not kept:
            return False
        new = np.array([[target if corner == vertex else corner for corner in face] for face in kept])
        a, b, c = self.points[new[:, 0]], self.points[new[:, 1]], self.points[new[:, 2]]
        cross = np.cross(b - a, c - a)
        area = np.linalg.norm(cross, axis=1)
        if (area < 1e-9).any():
            return False
        flat = cross / area[:, None]
        for k in range(3):
            if ((flat * self.normals[new[:, k]]).sum(axis=1) < 0.80).any():
                return False
        sides = np.concatenate([b - a, c - b, a - c])
        if np.linalg.norm(sides, axis=1).max() > self.longest:
            return False
        probes: Floats = np.concatenate([(a + b + c) / 3.0, (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0])
        return bool(np.abs(self.skin.field(probes)).max() < self.tolerance)

    def _pull(self, vertex: int, target: int) -> None:
        for index in list(self.around[vertex]):
            face = self.faces[index]
            if target in face:
                for corner in face:
                    self.around[corner].discard(index)
                del self.faces[index]
            else:
                a, b, c = (target if corner == vertex else corner for corner in face)
                self.faces[index] = (a, b, c)
                self.around[target].add(index)
        self.around[vertex] = set()

    def write_back(self) -> None:
        indices = sorted(self.faces)
        self.skin.triangles = np.array([self.faces[i] for i in indices], dtype=np.int64)
        self.skin.labels = np.array([self.labels[i] for i in indices], dtype=np.int64)
        self.skin.keep(np.ones(len(indices), dtype=bool))
