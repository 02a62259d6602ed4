"""Hand-written recordings of traffic."""

from collections.abc import Callable, Sequence

import numpy as np

from pavetwin.traffic.demand import Capacity
from pavetwin.traffic.kinds import KINDS
from pavetwin.traffic.recording import Agents, Origin, Recording
from pavetwin.traffic.tracks import PoseRows

STEP_S = 0.5
Pose = tuple[float, float, float, float]


def recording(kinds: Sequence[str], poses: Callable[[int, float], Pose], frames: int = 21) -> Recording:
    """Agents of some kinds; `poses(agent, time)` gives x, y, yaw and speed."""
    known = [KINDS[kind] if kind in KINDS else KINDS["suv"] for kind in kinds]
    poses_of = [poses(agent, k * STEP_S) for k in range(frames) for agent in range(len(kinds))]
    rows = np.array(poses_of, dtype=np.float32).reshape(-1, 4)
    return Recording.of_rows(
        origin=Origin("", "", 0, None, Capacity(1.0, 1.0), "", 0.0),
        step_s=STEP_S,
        agents=Agents(
            id=tuple(f"a{k}" for k in range(len(kinds))),
            kind=tuple(kinds),
            length_m=np.array([kind.length_m for kind in known], dtype=np.float32),
            width_m=np.array([kind.width_m for kind in known], dtype=np.float32),
            height_m=np.array([kind.height_m for kind in known], dtype=np.float32),
            is_pedestrian=np.array([kind.agent_class == "pedestrian" for kind in known], dtype=np.bool_),
        ),
        rows=PoseRows(
            step_offsets=(len(kinds) * np.arange(frames + 1)).astype(np.uint32),
            agent=np.tile(np.arange(len(kinds), dtype=np.uint32), frames),
            x=np.ascontiguousarray(rows[:, 0]),
            y=np.ascontiguousarray(rows[:, 1]),
            yaw_rad=np.ascontiguousarray(rows[:, 2]),
            speed_mps=np.ascontiguousarray(rows[:, 3]),
        ),
        signals={},
    )
