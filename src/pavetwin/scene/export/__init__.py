"""A world as one file that Blender, game engines and web pages open."""

from pavetwin.scene.export.write import ExportSummary, TrafficSnapshot, estimate, export_scene, tiles_of, usual_texel_m

__all__ = ["ExportSummary", "TrafficSnapshot", "estimate", "export_scene", "tiles_of", "usual_texel_m"]
