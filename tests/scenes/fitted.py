"""Fitted sensors whose parameters are stated, and looks that are drawn from them."""

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from pavetwin.files import file_sha256
from pavetwin.sensing.fit.look_tables import ALARM_SCHEMA, CAPTURE, GROUP, LOOK_COLUMNS, LookSource
from pavetwin.sensing.fitted_sensor import (
    OF_ALL,
    OF_CLASS,
    FalseAlarms,
    FittedDetector,
    FittedNumber,
    FittedTo,
    SensorModel,
    Variable,
    term_names,
)
from pavetwin.sensing.frame import Look
from scenes import drawn_detector

FILE = Path(__file__).parents[1] / "sensing" / "fitted.json"
"""`stated()` as a file. Written by `PYTHONPATH=src:tests python -m scenes.fitted`."""

CLASSES = ("crocodile_crack", "pothole", "single_crack")

EFFECTS = {
    **{"width": 0.3, "size": 0.6, "bend": -0.3, "inside": 0.4, "severity": 0.2},
    **{"resolution": -0.3, "visible": 0.3, "blur": -0.2, "clouds": 0.1},
}


def stated(*, spread: float = 1.0, level: float = 0.8, error: float = 0.1, alarms_per_m2: float = 0.01) -> SensorModel:
    """A sensor with the same parameters for each class.

    Args:
        spread: σ of the random effect.
        level: of a look whose variables are all at their centres.
        error: standard error of every parameter.
        alarms_per_m2: of potholes.
    """
    names = term_names(CLASSES)
    terms = {
        name: FittedNumber(
            estimate=level if name in CLASSES else EFFECTS.get(name.rpartition(":")[2], 0.0), standard_error=error
        )
        for name in names
    }
    return SensorModel(
        detector=FittedDetector(sha256=file_sha256(drawn_detector.FILE), confidence=0.25, image_px=2048),
        fitted_to=FittedTo(
            looks=1000, found=700, defects=300, repeated=280, images=200, area_m2=2e4, pixel_mm=(3, 14), sources=("a",)
        ),
        variables={name: Variable(centre=CENTRES.get(name, 0.0), scale=1.0) for name in (*OF_CLASS, *OF_ALL)},
        knots=dict.fromkeys(CLASSES, (5.0, 6.0, 7.0)),
        terms=terms,
        log_spread=FittedNumber(estimate=float(np.log(spread)), standard_error=error),
        covariance=tuple(tuple(map(float, row)) for row in error**2 * np.eye(len(names) + 1)),
        false_alarms={
            "pothole": FalseAlarms(
                level=FittedNumber(estimate=float(np.log(alarms_per_m2)), standard_error=error),
                slope=FittedNumber(estimate=0.0, standard_error=0.0),
                size_px=60.0,
            )
        }
        if alarms_per_m2
        else {},
    )


CENTRES = {"width": 1.0, "size": 6.0, "resolution": 3.0}


def drawn_looks(model: SensorModel, defects: int, looks: int, seed: int = 0, name: str = "drawn") -> LookSource:
    """Looks at defects of all classes and sizes, found as the model has it: the random effect once for each defect."""
    rng = np.random.default_rng(seed)
    rows: list[tuple[Any, ...]] = []
    for defect in range(defects):
        kind, severity = CLASSES[defect % 3], ("low", "medium", "high")[rng.integers(3)]
        width_px, size_px = 2 ** rng.normal(1, 1), 2 ** rng.normal(6, 1)
        effect = model.spread * rng.standard_normal()
        for _ in range(looks):
            look = Look(
                kind=kind,
                severity=severity,
                width_px=width_px,
                size_px=size_px,
                pixel_mm=2 ** rng.uniform(1.6, 3.8),
                visible_fraction=rng.uniform(0.35, 1),
                inside_fraction=rng.uniform(0.3, 1),
                off_centre=rng.uniform(0, 1),
                blur_px=rng.uniform(0, 3),
                sun_elevation_deg=rng.uniform(15, 80),
                clouds=rng.uniform(0, 1),
            )
            score = sum(model.terms[term].estimate * value for term, value in model.row(look).items())
            rows.append((f"{name} {defect}", bool(score + effect + rng.standard_normal() > 0), *look))
    schema = {GROUP: pl.String, "found": pl.Boolean, **LOOK_COLUMNS}
    per_image = 150.0
    images = pl.DataFrame(
        {"area_m2": [per_image] * defects, "pixel_mm": [float(mm) for mm in rng.uniform(3, 14, defects)]}
    ).with_columns(pl.lit(None, pl.String).alias(CAPTURE))
    alarms = [
        (image, kind, each.size_px)
        for kind, each in model.false_alarms.items()
        for image, pixel_mm in enumerate(images["pixel_mm"])
        for _ in range(rng.poisson(per_image * each.per_m2(pixel_mm / 1000)))
    ]
    return LookSource(
        name=name,
        detector=model.detector,
        looks=pl.DataFrame(rows, schema=schema, orient="row"),
        images=images,
        alarms=pl.DataFrame(alarms, schema=ALARM_SCHEMA, orient="row"),
    )


if __name__ == "__main__":
    stated().save(FILE)
