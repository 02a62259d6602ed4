"""Agents in a frame of a recording, their speeds, and the distances they have covered, from its key frames.

Parts are read on request, and few of them are kept: the memory of a recording does not grow with
its length, except for the distances of its agents at the beginning of each part.
"""

from bisect import bisect_right
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from pavetwin.arrays import BoolArray, Float32Array, Float64Array, Int64Array
from pavetwin.traffic.recording import Recording

PARTS_KEPT: Final = 4


class AgentStates(NamedTuple):
    """States of some agents in a frame. All arrays (n,)."""

    is_there: BoolArray
    speed_mps: Float32Array
    """0 of those that are not there, as the next."""
    travelled_m: Float64Array
    """Along the straight lines from frame to frame, since the agent appeared in the recording's window."""


@dataclass(frozen=True, eq=False)
class _Carried:
    """States of all agents at the beginning of a part. Arrays (agents,)."""

    travelled_m: Float64Array
    x_m: Float32Array
    """Last place of each; NaN for those that have not been in the window."""
    y_m: Float32Array


@dataclass(frozen=True, eq=False)
class _Part:
    """Key frames (n,) in ascending order of agent and step."""

    order: Int64Array
    """See `_order`."""
    is_last: BoolArray
    speed_mps: Float32Array
    travelled_m: Float64Array


class AgentStateReader:
    """The agents of a recording, frame by frame."""

    def __init__(self, recording: Recording) -> None:
        tracks, agents = recording.tracks, len(recording.agents)
        self._tracks, self._agents = tracks, agents
        self._first_part = self._part_of(tracks.first_step)
        nowhere = np.full(agents, np.nan, dtype=np.float32)
        self._carried = [_Carried(np.zeros(agents), nowhere, nowhere)]
        """Beginnings of parts, from the window's first one on."""
        self._read = lru_cache(PARTS_KEPT)(self._uncached)

    def at(self, who: Int64Array, frame: int) -> AgentStates:
        """The states of agents (n,) in a frame of the window; none is there after its end."""
        step = self._tracks.first_step + frame
        part = self._read(self._part_of(step)) if 0 <= frame < self._tracks.frames else None
        if part is None or not len(part.order):
            return AgentStates(np.zeros(len(who), np.bool_), np.zeros(len(who), np.float32), np.zeros(len(who)))
        asked = _order(who, np.full(len(who), step))
        at = np.searchsorted(part.order, asked, side="right") - 1
        held = part.order[at]
        is_there = (at >= 0) & (held >> 32 == who) & ((held == asked) | ~part.is_last[at])
        return AgentStates(
            is_there,
            np.where(is_there, part.speed_mps[at], np.float32(0)),
            np.where(is_there, part.travelled_m[at], 0.0),
        )

    def _part_of(self, step: int) -> int:
        return bisect_right(self._tracks.starts, step) - 1

    def _uncached(self, number: int) -> _Part:
        while len(self._carried) <= number - self._first_part:
            self._load(self._first_part + len(self._carried) - 1)
        return self._load(number)

    def _load(self, number: int) -> _Part:
        """A part, whose end is carried into the next one."""
        part, begins = self._tracks.parts[number].load(), self._tracks.first_step
        count = int(np.searchsorted(part.agent, self._agents))  # a longer recording's part may hold more than these
        agent, step, is_last = part.agent[:count].astype(np.int64), part.step[:count], part.is_last[:count]
        x, y, _, speed = (column[:count] for column in part.poses())
        carried = self._carried[number - self._first_part]
        is_first = np.append(True, agent[1:] != agent[:-1])[:count]
        before_x = np.where(is_first, carried.x_m[agent], np.append(np.float32(np.nan), x[:-1])[:count])
        before_y = np.where(is_first, carried.y_m[agent], np.append(np.float32(np.nan), y[:-1])[:count])
        # An agent that left before the window was not in it; one that was present and moves later has moved since.
        left = np.append(False, is_last[:-1] & (step[:-1] < begins))[:count] & ~is_first
        moved = np.hypot(x.astype(np.float64) - before_x, y.astype(np.float64) - before_y)
        moved[np.isnan(moved) | left | (step <= begins)] = 0.0
        total = np.cumsum(moved)
        starts = np.flatnonzero(is_first)
        base = np.repeat(
            total[starts] - moved[starts] - carried.travelled_m[agent[starts]], np.diff(np.append(starts, count))
        )
        so_far = total - base
        if len(self._carried) == number - self._first_part + 1:
            ends = np.append(starts[1:], count)[: len(starts)] - 1
            seen = ends[step[ends] >= begins]
            way, last_x, last_y = carried.travelled_m.copy(), carried.x_m.copy(), carried.y_m.copy()
            way[agent[seen]], last_x[agent[seen]], last_y[agent[seen]] = so_far[seen], x[seen], y[seen]
            self._carried.append(_Carried(way, last_x, last_y))
        return _Part(_order(agent, step.astype(np.int64)), is_last, speed, so_far)


def _order(agent: Int64Array, step: Int64Array) -> Int64Array:
    """Ascending by agent, then by step."""
    return agent << 32 | step
