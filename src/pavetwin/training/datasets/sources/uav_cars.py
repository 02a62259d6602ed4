"""UAV car detection: vehicles from the air, YOLO boxes. Every motor vehicle is a Car here."""

from pavetwin.training.datasets.layouts import YoloLayout
from pavetwin.training.datasets.rules import IGNORE
from pavetwin.training.datasets.sources.base import SOURCES, DatasetSource

SOURCES.add(
    "uav-cars",
    DatasetSource(
        title="UAV car detection (aerial-cars-dataset)",
        home="https://github.com/jekhor/aerial-cars-dataset",
        licence="differs by image: CC BY 3.0 (MOS*, MunichStreet*), CC BY-SA (DJI*), unclear (harlem*)",
        labels=YoloLayout(names=("car", "truck", "bus", "minibus", "cyclist")),
        classes={
            **dict.fromkeys(("car", "truck", "bus", "minibus"), "Car"),
            # Neither a motor vehicle nor someone on foot.
            "cyclist": IGNORE,
        },
        # Frames of one film share the name before the frame's number, as MOS75 and MunichStreet02 do without a dash.
        group=r"([^/]*?)[-_]?\d+\.\w+$",
    ),
)
