"""Pictures of models for the maker's eyes: `python -m assets.sheet [names] -o sheet.png`, drawn by Cycles on the CPU.

Each model is seen from above at `--mm` millimetres a pixel, from the front left, from the rear right and from the side,
on grey asphalt under a clear sky. Several models are several rows.
"""

import argparse
import tempfile
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Vector

from assets.models import load_families
from assets.models.common import MODELS, Floats, Model, ambient_occlusion
from assets.models.materials import MATERIALS

COLOURS = {
    "white": (0.72, 0.72, 0.70),
    "silver": (0.42, 0.43, 0.44),
    "grey": (0.085, 0.088, 0.092),
    "black": (0.010, 0.010, 0.011),
    "red": (0.32, 0.014, 0.014),
    "blue": (0.015, 0.045, 0.16),
}


def shader(name: str, paint: tuple[float, float, float]) -> Any:
    """A Blender material of ours, its colour multiplied by the baked one."""
    ours = MATERIALS[name]
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    surface = nodes["Principled BSDF"]
    surface.inputs["Roughness"].default_value = ours.roughness
    surface.inputs["Metallic"].default_value = ours.metallic
    if name == "paint":
        surface.inputs["Coat Weight"].default_value = 0.6
    baked = nodes.new("ShaderNodeVertexColor")
    baked.layer_name = "baked"
    mix = nodes.new("ShaderNodeMix")
    mix.data_type, mix.blend_type = "RGBA", "MULTIPLY"
    mix.inputs["Factor"].default_value = 1.0
    mix.inputs["A"].default_value = (*(paint if name == "paint" else ours.colour), 1.0)
    links.new(baked.outputs["Color"], mix.inputs["B"])
    links.new(mix.outputs["Result"], surface.inputs["Base Color"])
    return material


def put(model: Model, paint: tuple[float, float, float]) -> None:
    """The model into Blender's scene."""
    parts = model.by_material()
    for (name, part), openness in zip(parts.items(), ambient_occlusion(parts.values()), strict=True):
        data = bpy.data.meshes.new(name)
        data.from_pydata(part.vertices.tolist(), [], part.triangles.tolist())
        data.shade_smooth()
        data.normals_split_custom_set_from_vertices(part.normals.tolist())
        colours = data.attributes.new("baked", "FLOAT_COLOR", "POINT")
        shade = np.ones((len(part.vertices), 4))
        shade[:, :3] = part.tint * openness[:, None]
        colours.data.foreach_set("color", shade.reshape(-1))
        data.materials.append(shader(name, paint))
        bpy.context.scene.collection.objects.link(bpy.data.objects.new(name, data))


def fresh_scene(samples: int) -> Any:
    """Asphalt, a low sun from the right front and a blue sky."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.seed = samples, True, 0
    scene.view_settings.view_transform = "Standard"
    scene.world = bpy.data.worlds.new("sky")
    scene.world.use_nodes = True
    nodes = scene.world.node_tree.nodes
    nodes["Background"].inputs["Color"].default_value = (0.62, 0.74, 0.95, 1.0)
    nodes["Background"].inputs["Strength"].default_value = 0.5
    lamp = bpy.data.lights.new("sun", "SUN")
    lamp.energy, lamp.angle, lamp.color = 3.4, 0.01, (1.0, 0.95, 0.88)
    sun = bpy.data.objects.new("sun", lamp)
    sun.rotation_euler = (np.radians(40.0), 0.0, np.radians(50.0))
    scene.collection.objects.link(sun)
    bpy.ops.mesh.primitive_plane_add(size=400.0)
    asphalt = bpy.data.materials.new("asphalt")
    asphalt.use_nodes = True
    asphalt.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.12, 0.12, 0.115, 1.0)
    asphalt.node_tree.nodes["Principled BSDF"].inputs["Roughness"].default_value = 0.9
    bpy.context.object.data.materials.append(asphalt)
    return scene


def shoot(
    scene: Any, eye: Floats, target: Floats, size: tuple[int, int], span_m: float | None, fov_deg: float
) -> Floats:
    """One picture (h, w, 3) in [0, 1]; with `span_m`, parallel rays over that width with x to the right."""
    camera = bpy.data.cameras.new("camera")
    if span_m:
        camera.type, camera.ortho_scale = "ORTHO", span_m
    else:
        camera.angle = np.radians(fov_deg)
    thing = bpy.data.objects.new("camera", camera)
    thing.location = eye
    thing.rotation_euler = (0, 0, 0) if span_m else Vector((target - eye).tolist()).to_track_quat("-Z", "Y").to_euler()
    scene.collection.objects.link(thing)
    scene.camera = thing
    scene.render.resolution_x, scene.render.resolution_y = size
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(Path(folder) / "view.png")
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        return np.array(image.pixels[:]).reshape(size[1], size[0], -1)[::-1, :, :3]


def row(name: str, paint: str, mm: float, samples: int, height: int) -> Floats:
    """The four views of a model beside each other."""
    scene = fresh_scene(samples)
    made = MODELS[name]()
    put(made, COLOURS[paint])
    points = np.concatenate([part.vertices for part in made.parts])
    low, high = points.min(axis=0), points.max(axis=0)
    reach, middle = float(np.linalg.norm(high - low)), (low + high) / 2.0
    wide = int(1000.0 * (high[0] - low[0] + 1.0) / mm)
    views = [shoot(scene, np.array([middle[0], 0.0, 60.0]), middle, (wide, height), wide * mm / 1000.0, 0.0)]
    for direction in ((0.9, 0.55, 0.45), (-0.9, -0.55, 0.75), (0.1, -1.0, 0.15)):
        eye = middle + 1.75 * reach * np.array(direction) / np.linalg.norm(direction)
        views.append(shoot(scene, eye, middle, (int(1.5 * height), height), None, 34.0))
    return np.concatenate(views, axis=1)


def save(pixels: Floats, path: Path) -> None:
    image = bpy.data.images.new("sheet", pixels.shape[1], pixels.shape[0])
    rgba = np.ones((*pixels.shape[:2], 4))
    rgba[..., :3] = pixels
    image.pixels = rgba[::-1].reshape(-1).tolist()
    image.filepath_raw, image.file_format = str(path), "PNG"
    image.save()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="models to draw (default: all)")
    parser.add_argument("-o", "--output", type=Path, default=Path("sheet.png"))
    parser.add_argument("--mm", type=float, default=8.0, help="millimetres a pixel from above")
    parser.add_argument("--samples", type=int, default=16)
    parser.add_argument("--height", type=int, default=360, help="pixels a row")
    parser.add_argument("--paint", nargs="*", default=["silver"], choices=sorted(COLOURS), help="of the rows in turn")
    options = parser.parse_args()
    load_families()
    names = options.names or sorted(MODELS)
    rows = [
        row(name, options.paint[i % len(options.paint)], options.mm, options.samples, options.height)
        for i, name in enumerate(names)
    ]
    wide = max(one.shape[1] for one in rows)
    save(np.concatenate([np.pad(one, ((0, 0), (0, wide - one.shape[1]), (0, 0))) for one in rows]), options.output)


if __name__ == "__main__":
    main()
