"""A dataset of six labelled images from 10 m, as YOLO files. Needs something that renders: see `pavetwin doctor`."""

import sys
from pathlib import Path

import pavetwin as pt
from pavetwin.capture.run import capture
from pavetwin.capture.scene_renderer import SceneFrameSource
from pavetwin.capture.settings import CaptureSettings
from pavetwin.render.adapter import find_adapter

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/dataset_example")
built = pt.add_defects(pt.build_world(Path(__file__).parent / "crossroads.osm"), pt.DefectOptions(per_segment=20))
pt.save_world(built, folder / "crossroads", force=True)
settings = CaptureSettings(
    platforms=("uav",),
    images=6,
    altitudes_m=(10.0,),
    densities=("medium",),
    size_px=(320, 320),
    formats=("yolo",),
    split=(1.0, 0.0, 0.0),  # two streets cannot be split into train, val and test
)
dataset = capture(
    folder / "crossroads",
    settings,
    folder / "dataset",
    frame_source_factory=SceneFrameSource,
    adapter=str(find_adapter()),
)
print(f"{dataset.taken} images in {dataset.folder}; labels: {dict(dataset.statistics.labelled)}")
