"""Instanced models, read from the package's .glb files into merged meshes.

Every part of a model becomes one mesh, whatever its materials: colour (base colour × vertex colour, which holds the
baked ambient occlusion), roughness, metallic and the slot for the instance's own colour go into its vertices. They
are double-sided, with unchanged normals: crowns are cards, cut out by the atlas of `foliage`.
"""

from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from pavetwin.scene.glb import Glb, from_file_axes, read_glb
from pavetwin.scene.meshes import merged
from pavetwin.scene.values import Mesh, Model

SLOTS: Final[Mapping[str, int]] = MappingProxyType(
    {
        **{"paint": 1, "lamp_rear": 2},
        **{"top": 1, "bottom": 2, "hair": 3, "skin": 4},
        **{"lamp_red": 1, "lamp_amber": 2, "lamp_green": 3},
        **{"leaf": 1},
    }
)
"""Material → the slot of `Instance.tints` that multiplies its colour; all other materials keep theirs."""

BODY: Final = "body"
"""Name of the part of a model with a single part."""

FAR: Final = "far"
SHADOW: Final = "shadow"
"""Names of the parts of some models: for their body seen from far away, and to cast its shadow."""


@cache
def library() -> Mapping[str, Model]:
    """All models of the package, by name."""
    folder = Path(str(files("pavetwin.scene") / "models"))
    return MappingProxyType({path.stem: load_model(path) for path in sorted(folder.glob("*.glb"))})


def load_model(path: Path) -> Model:
    """Read one model. Its nodes with a mesh are its parts; a single one is called `body`.

    Raises:
        ValueError: the file is not binary glTF 2.0, or a primitive is not a list of triangles with normals.
    """
    glb = read_glb(path)
    nodes = [node for node in glb.document["nodes"] if "mesh" in node]
    if not nodes:
        raise ValueError(f"{path.name} holds no mesh")
    if any({"matrix", "translation", "rotation", "scale"} & set(node) for node in nodes):
        raise ValueError(f"{path.name}: a node is moved; models have their meshes where they belong")
    names = [BODY] if len(nodes) == 1 else [str(node["name"]) for node in nodes]
    extras: dict[str, float] = {}
    for holder in (glb.document["asset"], *nodes):
        extras |= {
            key: float(value) for key, value in holder.get("extras", {}).items() if isinstance(value, int | float)
        }
    person = str(glb.document["asset"].get("extras", {}).get("kind", ""))
    meshes = [glb.document["meshes"][node["mesh"]]["primitives"] for node in nodes]
    parts = {
        name: merged([_primitive(glb, each) for each in primitives])
        for name, primitives in zip(names, meshes, strict=True)
    }
    return Model(path.stem, MappingProxyType(parts), MappingProxyType(extras), person=person)


def _primitive(glb: Glb, primitive: Mapping[str, Any]) -> Mesh:
    attributes = primitive["attributes"]
    if primitive.get("mode", 4) != 4 or "NORMAL" not in attributes or "indices" not in primitive:
        raise ValueError("a primitive of a model is not an indexed list of triangles with normals")
    positions = from_file_axes(glb.array(attributes["POSITION"]))
    material = glb.document["materials"][primitive["material"]]
    pbr = material.get("pbrMetallicRoughness", {})
    colours = np.broadcast_to(np.array(pbr.get("baseColorFactor", (1, 1, 1, 1))[:3]), (len(positions), 3))
    if "COLOR_0" in attributes:
        colours = colours * glb.array(attributes["COLOR_0"])[:, :3]
    surface = np.empty((len(positions), 3), dtype=np.uint8)
    surface[:, 0] = round(255 * pbr.get("roughnessFactor", 1.0))
    surface[:, 1] = round(255 * pbr.get("metallicFactor", 1.0))
    surface[:, 2] = SLOTS.get(material["name"], 0)
    normals = from_file_axes(glb.array(attributes["NORMAL"]))
    triangles = glb.array(primitive["indices"]).astype(np.uint32).reshape(-1, 3)
    uv = glb.array(attributes["TEXCOORD_0"]) if "TEXCOORD_0" in attributes else None
    return Mesh(positions, normals, triangles, np.ascontiguousarray(colours, dtype=np.float32), surface, uv)
