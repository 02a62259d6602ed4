"""Severity of a defect: low, medium or high after ASTM D6433 (pavement condition index surveys of roads).

Where the standard gives millimetres, they are used. Where it only describes (alligator cracking), we use our own
thresholds for its terms; `docs/explanation/defects.md` lists them.

`Distress` lists the distresses of asphalt that count in the Pavement Condition Index.
"""

from enum import StrEnum

from pavetwin.defects.measures import Measures
from pavetwin.world.model import Severity

CRACK_MEDIUM_M, CRACK_HIGH_M = 0.010, 0.075
"""Longitudinal and transverse cracking: below 10 mm low, 10 to 75 mm medium, above high."""

POTHOLE_DEPTHS_M = (0.025, 0.050)
POTHOLE_DIAMETERS_M = (0.200, 0.450, 0.750)
_L, _M, _H = Severity.LOW, Severity.MEDIUM, Severity.HIGH
POTHOLE_TABLE = (
    (_L, _L, _M),
    (_L, _M, _H),
    (_M, _M, _H),
)
"""Rows: deepest point up to 25 mm, up to 50 mm, beyond. Columns: mean diameter up to 200, 450 and 750 mm."""

SPALLED_MEDIUM, SPALLED_HIGH = 0.04, 0.15
"""Broken surface as a share of a strip of 3 cm along the cracks: "lightly spalled", "spalled at the edges"."""
SPALL_STRIP_M = 0.03
SUNKEN_HIGH_M = 0.012
"""Depth of pieces that sank, tilted or are lost: in the standard "some pieces may rock under traffic"."""


def crack_severity(measures: Measures) -> Severity:
    """Severity of a single crack, by its width."""
    return severity_of_width(measures.width_m)


def severity_of_width(width_m: float) -> Severity:
    """Severity of a single crack of this width."""
    if width_m < CRACK_MEDIUM_M:
        return Severity.LOW
    return Severity.MEDIUM if width_m <= CRACK_HIGH_M else Severity.HIGH


def pothole_severity(measures: Measures) -> Severity:
    """Severity of a pothole, by depth and diameter."""
    return severities_of_diameter(measures.diameter_m)[sum(measures.depth_m > limit for limit in POTHOLE_DEPTHS_M)]


def severities_of_diameter(diameter_m: float) -> tuple[Severity, ...]:
    """Severities of a pothole of this diameter, for each class of depth (`POTHOLE_DEPTHS_M`); above 750 mm across it is
    medium up to 25 mm deep and high beyond."""
    column = sum(diameter_m > limit for limit in POTHOLE_DIAMETERS_M)
    if column == len(POTHOLE_DIAMETERS_M):
        return Severity.MEDIUM, Severity.HIGH, Severity.HIGH
    return tuple(row[column] for row in POTHOLE_TABLE)


def crocodile_severity(measures: Measures) -> Severity:
    """Severity of a crocodile crack, by the broken share of its cracks' edges and by moved pieces."""
    strip = measures.crack_length_m * SPALL_STRIP_M
    spalled = measures.exposed_m2 / strip if strip > 0 else 0.0
    if spalled > SPALLED_HIGH or measures.sunken_m > SUNKEN_HIGH_M:
        return Severity.HIGH
    return Severity.MEDIUM if spalled > SPALLED_MEDIUM else Severity.LOW


class Distress(StrEnum):
    """A type of distress of asphalt surfaces; the value is its name in tables and files."""

    ALLIGATOR_CRACKING = "alligator_cracking"
    BLOCK_CRACKING = "block_cracking"
    EDGE_CRACKING = "edge_cracking"
    JOINT_REFLECTION_CRACKING = "joint_reflection_cracking"
    LONGITUDINAL_AND_TRANSVERSE_CRACKING = "longitudinal_and_transverse_cracking"
    PATCHING = "patching"
    POTHOLES = "potholes"
    RAVELING = "raveling"
    RUTTING = "rutting"
    SHOVING = "shoving"

    @property
    def unit(self) -> str:
        """Unit of its quantity: `m`, `number` or `m²`."""
        return _UNITS.get(self, "m²")


_UNITS = {
    Distress.EDGE_CRACKING: "m",
    Distress.JOINT_REFLECTION_CRACKING: "m",
    Distress.LONGITUDINAL_AND_TRANSVERSE_CRACKING: "m",
    Distress.POTHOLES: "number",
}
