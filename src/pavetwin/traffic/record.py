"""Record traffic as far as it is needed, and reuse recordings by the hash of their inputs."""

import math
import time
from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from typing import Final, Self
from weakref import finalize

from pavetwin.errors import PaveTwinError
from pavetwin.files import check_writable
from pavetwin.memory import give_back
from pavetwin.traffic.demand import Density
from pavetwin.traffic.demand_search import found
from pavetwin.traffic.flow import to_recording
from pavetwin.traffic.inputs import Inputs
from pavetwin.traffic.job import STEP_S
from pavetwin.traffic.recording import Recording, frames_of
from pavetwin.traffic.recording_file import load_recording, save_recording
from pavetwin.traffic.runner import OnRecorded, SimulationProcess, require_sumo, termination_as_exit, workplace
from pavetwin.traffic.town_trips import with_area_traffic
from pavetwin.world.folder import CACHE_VARIABLE
from pavetwin.world.model import World

LONGEST_S: Final = 86400.0

FRAMES_AT_ONCE: Final = 480
"""Four minutes: as many come from SUMO's process unpacked, so that memory does not grow with a recording's length."""


def record(
    world: World,
    density: Density | str | None,
    seed: int,
    duration_s: float,
    *,
    routes: Sequence[str | Path] = (),
    force: bool = False,
    on_progress: OnRecorded | None = None,
    on_search: OnRecorded | None = None,
) -> Recording:
    """Traffic over `world` for `duration_s` seconds, from the world's cache or from SUMO.

    The result depends on the world, the density, the seed and the routes alone, not on earlier recordings.
    `density` is ignored where `routes` (unchanged SUMO route files) are given; `force` records even if the file exists.
    `on_search` receives the share done of the search for the demand of a level of service, before the recording.

    Raises:
        PaveTwinError: SUMO is missing or refuses its input, or the file cannot be written.
    """
    with Recorder(Inputs.of(world, density, seed, routes), force=force) as recorder:
        return recorder.until(duration_s, on_progress, on_search)


class Recorder:
    """The traffic of one set of inputs, extended on request.

    SUMO's process stays alive, paused, until the context ends or the recorder is garbage collected. A recording is
    written immediately, in a `with` block at its end. Where a stored recording is too short, SUMO starts again and must
    reproduce it.
    """

    def __init__(self, inputs: Inputs, *, force: bool = False, unchanged: Path | None = None) -> None:
        """
        Args:
            force: record again, whatever is in the cache.
            unchanged: a file that is never written, even where it is the one in the cache.
        """
        self._inputs = inputs
        self.damaged: list[Path] = []
        """Files in the cache that cannot be read, and are recorded again."""
        self._longest = None if force else self._kept()
        """The longest recording so far."""
        self.pace: float | None = None
        """Real seconds that a second of the latest recording took; None before the first."""
        self._written = self._longest
        self._unchanged = unchanged
        self._entered = False
        self._simulation: SimulationProcess | None = None
        """A running simulation is at the end of `_longest`."""
        self._alive = ExitStack()
        finalize(self, self._alive.close)

    @classmethod
    def of(
        cls, recording: Recording, world: World, routes: Sequence[str | Path] = (), *, unchanged: Path | None = None
    ) -> Self:
        """Create a recorder for traffic that begins with `recording`.

        Args:
            unchanged: a file that is never written, even where it is the one in the cache: a mission names it with its
                hash.

        Raises:
            PaveTwinError: the recording is of another world or of other routes than these.
        """
        if recording.origin.asked is None and not routes:
            raise PaveTwinError(
                f"A mission outlasts this recording of {recording.duration_s:g} s, and the routes it was made from are "
                "not given; record longer, or give the routes instead."
            )
        origin = recording.origin
        inputs = Inputs.of(world, origin.asked, origin.seed, routes, origin.area)
        if origin.world != world.content_hash or origin.inputs != inputs.hash:
            raise PaveTwinError(
                "This recording cannot be extended: its world, its routes or SUMO's version is another now; "
                "record again."
            )
        recorder = cls(inputs, unchanged=unchanged)
        recorder._take(recording)
        return recorder

    def until(
        self, duration_s: float, on_progress: OnRecorded | None = None, on_search: OnRecorded | None = None
    ) -> Recording:
        """The first `duration_s` seconds.

        Raises:
            PaveTwinError: as `beyond`.
        """
        return self.beyond(duration_s, on_progress, on_search).until(duration_s)

    def beyond(
        self, duration_s: float, on_progress: OnRecorded | None = None, on_search: OnRecorded | None = None
    ) -> Recording:
        """The longest recording so far, `duration_s` seconds at least.

        Raises:
            PaveTwinError: SUMO is missing, refuses its input, crashes or does not reproduce its earlier recording, or
                the file cannot be written.
        """
        if not math.isfinite(duration_s) or not 0 < duration_s <= LONGEST_S:
            raise PaveTwinError(
                f"The duration must be above 0 and at most {LONGEST_S:.0f} s (a day), not {duration_s:g} s."
            )
        frames = frames_of(duration_s, STEP_S)
        if self._longest is None or self._longest.frames < frames:
            with termination_as_exit():
                self._simulate(frames, on_progress, on_search)
                if not self._entered:
                    self._write()
        assert self._longest is not None
        return self._longest

    def simulated_s(self, duration_s: float) -> float:
        """Seconds that SUMO simulates to record this long: all of them, unless it still runs."""
        known = self._longest if self._simulation is not None else None
        return max(0.0, duration_s - (known.duration_s if known is not None else 0.0))

    def __enter__(self) -> Self:
        self._entered = True
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._end()
        self._entered = False
        if kind is None:
            self._write()

    def _kept(self) -> Recording | None:
        """The recording in the cache, if it was made from the same inputs; a damaged file is noted."""
        path = self._inputs.path
        try:
            found = load_recording(path) if path.exists() else None
        except PaveTwinError:
            self.damaged.append(path)
            return None
        return found if found is not None and found.origin.inputs == self._inputs.hash else None

    def _write(self) -> None:
        path = self._inputs.path
        if self._unchanged is not None and path.exists() and path.samefile(self._unchanged):
            return
        if self._longest is not None and self._longest is not self._written:
            give_back()  # of whatever was done since; the whole file is put together in memory
            save_recording(self._longest, path)
            self._longest = self._written = load_recording(path)  # its parts need not stay in memory

    def _take(self, recording: Recording) -> None:
        """Keep `recording` when it is longer; it must agree with the recording so far."""
        known = self._longest
        if known is not None:
            shared_s = min(known.duration_s, recording.duration_s)
            if not recording.until(shared_s).same_traffic(known.until(shared_s)):
                raise PaveTwinError(
                    f"SUMO did not repeat the traffic of '{self._inputs.path}', so it cannot be extended; record it "
                    "again with `pavetwin traffic record WORLD --force`."
                )
        if known is None or known.frames < recording.frames:
            self._longest = recording

    def _simulate(self, frames: int, on_progress: OnRecorded | None, on_search: OnRecorded | None) -> None:
        """Record the first `frames` frames, by the running simulation or by a new one."""
        goes_on = self._simulation is not None
        before = self._longest if goes_on else None
        simulated_s, begun = self.simulated_s(frames * STEP_S), time.monotonic()
        try:
            simulation = self._simulation or self._begin(on_search)
            self._simulation = simulation
            begin = before.frames if before is not None else 0
            starts = range(begin, frames, FRAMES_AT_ONCE)
            simulation.begin(min(FRAMES_AT_ONCE, frames - begin))
            for first in starts:
                count = min(FRAMES_AT_ONCE, frames - first)
                part = simulation.finish(on_progress and _part_of(on_progress, (first - begin, count, frames - begin)))
                if first != starts[-1]:  # SUMO goes on while this process packs what it has
                    simulation.begin(min(FRAMES_AT_ONCE, frames - first - count))
                origin, limits = self._inputs.origin(part), self._inputs.speed_limits
                before = replace(to_recording(part, origin, limits, before), path=self._inputs.path)
                del part
                give_back()
        except BaseException:
            self._end()  # its position is unknown
            raise
        assert before is not None
        self.pace = (time.monotonic() - begun) / max(simulated_s, STEP_S)
        if goes_on:
            self._longest = before
        else:
            self._take(before)

    def _begin(self, on_search: OnRecorded | None) -> SimulationProcess:
        require_sumo()
        check_writable(self._inputs.path, f"{CACHE_VARIABLE} names one.")
        self._inputs = with_area_traffic(found(self._inputs, on_search), on_search)
        folder = self._alive.enter_context(workplace())
        return self._alive.enter_context(closing(SimulationProcess(self._inputs.job(folder))))

    def _end(self) -> None:
        self._simulation = None
        self._alive.close()


def _part_of(report: OnRecorded, done_now_all: tuple[int, int, int]) -> OnRecorded:
    """Report progress within some frames as the share of all frames, of which some are done before."""
    done, now, whole = done_now_all
    return lambda share: report((done + share * now) / whole)
