"""Reads the committed models node by node and material by material, for tests."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pavetwin.scene.glb import from_file_axes, read_glb

FOLDER = Path(__file__).parent.parent / "src" / "pavetwin" / "scene" / "models"


@dataclass(frozen=True)
class Surface:
    """One material of one node, in the model's own frame."""

    positions: npt.NDArray[np.float32]
    normals: npt.NDArray[np.float32]
    colours: npt.NDArray[np.float32]
    triangles: npt.NDArray[np.int64]


@dataclass(frozen=True)
class ModelFile:
    nodes: dict[str, dict[str, Surface]]
    extras: dict[str, Any]

    def triangles(self, node: str) -> int:
        return sum(len(surface.triangles) for surface in self.nodes[node].values())


def read_model(name: str) -> ModelFile:
    glb = read_glb(FOLDER / f"{name}.glb")
    document = glb.document
    nodes: dict[str, dict[str, Surface]] = {}
    for node in document["nodes"]:
        surfaces = {}
        for primitive in document["meshes"][node["mesh"]]["primitives"]:
            attributes = primitive["attributes"]
            surfaces[document["materials"][primitive["material"]]["name"]] = Surface(
                from_file_axes(glb.array(attributes["POSITION"])),
                from_file_axes(glb.array(attributes["NORMAL"])),
                glb.array(attributes["COLOR_0"])[:, :3],
                glb.array(primitive["indices"]).astype(np.int64).reshape(-1, 3),
            )
        nodes[node["name"]] = surfaces
    return ModelFile(nodes, document["asset"].get("extras", {}))


def points(surfaces: dict[str, Surface], *, without: frozenset[str] = frozenset()) -> npt.NDArray[np.float32]:
    """All vertices of a node (n, 3), without those of some materials."""
    return np.concatenate([surface.positions for name, surface in surfaces.items() if name not in without])
