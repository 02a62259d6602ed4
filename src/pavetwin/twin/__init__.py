"""The digital twin D_t as values: missions create them, policies and sensors read them."""

from pavetwin.traffic.kinds import AgentClass
from pavetwin.twin.snapshot import Episode, Moment, Occlusion, Snapshot
from pavetwin.twin.state import Agent, Confirmation, InspectionMemory, Mode, Note, Place, SegmentStatus, UavState

__all__ = [
    "Agent",
    "AgentClass",
    "Confirmation",
    "Episode",
    "InspectionMemory",
    "Mode",
    "Moment",
    "Note",
    "Occlusion",
    "Place",
    "SegmentStatus",
    "Snapshot",
    "UavState",
]
