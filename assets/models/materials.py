"""The materials of all models: flat factors of glTF's metallic-roughness model, one list for every family."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Material:
    """One material. `colour` is linear RGB in [0, 1]; the vertex colours multiply it."""

    colour: tuple[float, float, float]
    roughness: float
    metallic: float = 0.0
    double_sided: bool = False


MATERIALS: Final[dict[str, Material]] = {
    # Vehicles
    "paint": Material((1.0, 1.0, 1.0), 0.28),
    "glass": Material((0.085, 0.098, 0.105), 0.06),
    "trim": Material((0.012, 0.012, 0.013), 0.45),
    "gap": Material((0.004, 0.004, 0.004), 0.9),
    "plastic": Material((0.028, 0.028, 0.030), 0.62),
    "tyre": Material((0.018, 0.018, 0.018), 0.9),
    "rim": Material((0.42, 0.43, 0.44), 0.38, 0.75),
    "chrome": Material((0.75, 0.76, 0.77), 0.18, 1.0),
    "lamp_front": Material((0.62, 0.65, 0.68), 0.08),
    "lamp_rear": Material((0.36, 0.012, 0.010), 0.12),
    "lamp_indicator": Material((0.80, 0.25, 0.02), 0.15),
    "plate": Material((0.72, 0.72, 0.68), 0.45),
    "box": Material((0.78, 0.78, 0.76), 0.5),
    "shell": Material((0.82, 0.82, 0.81), 0.3),
    "metal": Material((0.30, 0.30, 0.31), 0.5, 0.8),
    # A rider's own, not `top` and `bottom`: on a vehicle those places are the paint's and the lamps'.
    "leather": Material((0.026, 0.025, 0.025), 0.55),
    "denim": Material((0.030, 0.042, 0.080), 0.9),
    # People
    "skin": Material((0.48, 0.28, 0.20), 0.6),
    "hair": Material((0.030, 0.019, 0.012), 0.75),
    "top": Material((1.0, 1.0, 1.0), 0.85),
    "bottom": Material((1.0, 1.0, 1.0), 0.85),
    "shoes": Material((0.030, 0.027, 0.025), 0.7),
    "bag": Material((0.10, 0.08, 0.07), 0.7),
    "wood": Material((0.13, 0.075, 0.04), 0.6),
    "hat": Material((0.09, 0.085, 0.08), 0.85),
    # Street
    "bark": Material((0.11, 0.085, 0.065), 0.95),
    "leaf": Material((0.135, 0.210, 0.045), 0.75, double_sided=True),
    "concrete": Material((0.42, 0.41, 0.39), 0.9),
    "housing": Material((0.022, 0.024, 0.024), 0.55),
    "mast": Material((0.27, 0.28, 0.28), 0.5, 0.6),
    "lens": Material((0.70, 0.70, 0.64), 0.15),
    "lamp_red": Material((0.34, 0.020, 0.014), 0.18),
    "lamp_amber": Material((0.42, 0.17, 0.010), 0.18),
    "lamp_green": Material((0.020, 0.24, 0.13), 0.18),
    "sign_red": Material((0.42, 0.016, 0.020), 0.4),
    "sign_white": Material((0.76, 0.76, 0.74), 0.4),
    "sign_black": Material((0.012, 0.012, 0.012), 0.5),
    "cast_iron": Material((0.030, 0.031, 0.032), 0.6, 0.4),
    "signal_paint": Material((0.40, 0.022, 0.016), 0.45),
}
"""By name. White ones (`paint`, `top`, `bottom`) take the colour of the individual when the scene is put together."""
