"""The distresses of asphalt by ASTM D6433, as which classes of defects count in the Pavement Condition Index."""

from enum import StrEnum


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
        """What its quantity is measured in: `m`, `number` or `m²`."""
        return _UNITS.get(self, "m²")


_UNITS = {
    Distress.EDGE_CRACKING: "m",
    Distress.JOINT_REFLECTION_CRACKING: "m",
    Distress.LONGITUDINAL_AND_TRANSVERSE_CRACKING: "m",
    Distress.POTHOLES: "number",
}
