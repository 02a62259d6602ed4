"""Published datasets of pavement, vehicles and people, mostly from UAVs: layout, licence and class rules of each."""

from pavetwin.training.datasets.layouts import VocLayout, YoloLayout
from pavetwin.training.datasets.sources.registry import DISCARD, DROP, IGNORE, SOURCES, DatasetSource

SOURCES.add(
    "rdd2022-china-drone",
    DatasetSource(
        title="RDD2022, China drone subset (Arya et al. 2022)",
        home="https://github.com/sekilab/RoadDamageDetector",
        licence="CC BY-SA 4.0 as copies of it state; cite it",
        labels=VocLayout(),
        classes={
            "D00": "Single Crack",
            "D10": "Single Crack",
            "D20": "Crocodile Crack",
            "D40": "Pothole",
            "Repair": DROP,
            # It is damage, so it is not background either.
            "Block crack": IGNORE,
        },
    ),
)


SOURCES.add(
    "uapd",
    DatasetSource(
        title="UAPD",
        home="https://github.com/tantantetetao/UAPD-Pavement-Distress-Dataset",
        licence="released for public use",
        labels=VocLayout(),
        classes={
            **dict.fromkeys(("longitudinal crack", "LC"), "Single Crack"),
            **dict.fromkeys(("transverse crack", "TC"), "Single Crack"),
            **dict.fromkeys(("oblique crack", "OC"), "Single Crack"),
            **dict.fromkeys(("alligator crack", "AC"), "Crocodile Crack"),
            **dict.fromkeys(("pothole", "PH"), "Pothole"),
            **dict.fromkeys(("repair", "RP"), DROP),
        },
    ),
)


SOURCES.add(
    "uav-pdd2023",
    DatasetSource(
        title="UAV-PDD2023",
        home="https://zenodo.org/records/8429208",
        licence="CC BY 4.0",
        labels=VocLayout(ending="_annotation"),
        classes={
            "longitudinal crack": "Single Crack",
            "transverse crack": "Single Crack",
            "oblique crack": "Single Crack",
            "alligator crack": "Crocodile Crack",
            "pothole": "Pothole",
            "repair": DROP,
        },
    ),
)


SOURCES.add(
    "highrpd",
    DatasetSource(
        title="HighRPD: a high-altitude drone dataset of road pavement distress (He et al. 2025)",
        home="https://data.mendeley.com/datasets/sywswj7djj/1",
        licence="CC BY 4.0",
        labels=YoloLayout(names=("line", "block", "pit")),
        # From 50 m a pit hardly differs from a stain, so no image with one is used.
        classes={"line": "Single Crack", "block": "Crocodile Crack", "pit": DISCARD},
    ),
)


SOURCES.add(
    "pothole-recognition",
    DatasetSource(
        title="Pothole-Recognition (Silva et al. 2020)",
        home="https://github.com/luisaugustos/Pothole-Recognition",
        licence="none stated",
        labels=YoloLayout(names=("agujero", "grietas")),
        classes={
            "agujero": "Pothole",
            "pothole": "Pothole",
            "grietas": "Single Crack",
            "crack": "Single Crack",
        },
    ),
)


SOURCES.add(
    "pothrgbd",
    DatasetSource(
        title="PothRGBD (Yurdakul and Tasdemir 2025)",
        home="https://www.kaggle.com/datasets/mahyeks/pothrgbd-rgb-and-depth-images-of-potholes",
        licence="see its page (others report MIT)",
        labels=YoloLayout(names=("pothole",), polygons=True),
        classes={"pothole": "Pothole"},
    ),
)


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


SOURCES.add(
    "uav-people",
    DatasetSource(
        title="Top-view pedestrian recognition (reference 26 of arXiv:2606.20742: 215 images, 17,034 people)",
        licence="see its page",
        labels=YoloLayout(names=("person",)),
        classes=dict.fromkeys(("person", "people", "pedestrian"), "Person"),
    ),
)
