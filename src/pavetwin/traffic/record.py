"""Record traffic once, and find it again by the hash of what it was made from."""

import hashlib
import json
import math
import os
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

from pavetwin.errors import PaveTwinError
from pavetwin.files import unwritable
from pavetwin.seeds import Stream, child
from pavetwin.traffic import closed_loop, sumo_run
from pavetwin.traffic.convert import to_recording
from pavetwin.traffic.demand import USER, Capacity, Density, density_named
from pavetwin.traffic.kinds import sumo_types
from pavetwin.traffic.recording import Origin, Recording, frames_of, load_recording, save_recording
from pavetwin.traffic.runner import OnProgress, require_sumo, run_job, termination_as_exit, workplace
from pavetwin.world.model import World

BEHAVIOUR: Final = 1
"""Counted up when the demand or the conversion changes what is recorded: an older file is then recorded anew."""

WARM_UP_S: Final = (120.0, 300.0)
"""The shortest and the longest time before a recording begins: queues before signals need a few of their cycles."""

LONGEST_S: Final = 86400.0


def record(
    world: World,
    density: Density | str | None,
    seed: int,
    duration_s: float,
    *,
    routes: Sequence[str | Path] = (),
    force: bool = False,
    on_progress: OnProgress | None = None,
) -> Recording:
    """Traffic over `world` for `duration_s` seconds, from the world's `traffic/` folder or from SUMO.

    What comes back depends on the world, the density, the seed and the routes alone: not on whether, when and how long
    it was recorded before. `density` is ignored where `routes` (SUMO route files, driven as they are) are given;
    `force` records even where the file is there.

    Raises:
        PaveTwinError: SUMO is missing or refuses its input, or the file cannot be written.
    """
    files = [Path(route) for route in routes]
    asked = None if files else density_named(density) if isinstance(density, str) else density
    if asked is None and not files:
        raise PaveTwinError("Say how much traffic: a density, or your own routes.")
    _check(seed, duration_s, files)
    inputs = _inputs(world, asked, seed, files)
    path = recording_path(world, asked, seed, files)
    kept = None if force else _kept(path, inputs)
    if kept is not None and kept.frames >= frames_of(duration_s, kept.step_s):
        return kept.until(duration_s)
    with termination_as_exit():
        fresh = _record(world, asked, seed, duration_s, files, inputs, path, on_progress)
        if kept is not None and not fresh.until(kept.duration_s).same_traffic(kept):
            raise PaveTwinError(
                f"SUMO did not repeat the traffic of '{path}', so it cannot be prolonged; record it again with --force."
            )
        return save_recording(fresh, path)


def prolong(
    recording: Recording,
    world: World,
    duration_s: float,
    *,
    routes: Sequence[str | Path] = (),
    on_progress: OnProgress | None = None,
) -> Recording:
    """The same traffic for longer: its first `recording.duration_s` are the same to the last bit.

    Raises:
        PaveTwinError: as `record`; or the recording is of another world or of other routes than these.
    """
    files = [Path(route) for route in routes]
    origin, shared_s = recording.origin, min(recording.duration_s, duration_s)
    if origin.world != world.content_hash or origin.inputs != _inputs(world, origin.asked, origin.seed, files):
        raise PaveTwinError(
            "This recording cannot be prolonged: its world, its routes or SUMO's version is another now; record again."
        )
    longer = record(world, origin.asked, origin.seed, duration_s, routes=files, on_progress=on_progress)
    if not longer.until(shared_s).same_traffic(recording.until(shared_s)):
        raise PaveTwinError("SUMO did not repeat this recording's traffic, so it cannot be prolonged; record it again.")
    return longer


def recording_path(world: World, density: Density | None, seed: int, routes: Sequence[Path] = ()) -> Path:
    """Where this traffic is kept: `NAME/traffic/<density>-<seed>.parquet`."""
    name = density.name if density is not None else "-".join([USER, *(_stem(path) for path in routes)])
    return world.network_file.parent / "traffic" / f"{name}-{seed}.parquet"


def _check(seed: int, duration_s: float, routes: Sequence[Path]) -> None:
    if not math.isfinite(duration_s) or not 0 < duration_s <= LONGEST_S:
        raise PaveTwinError(
            f"The duration must be above 0 and at most {LONGEST_S:.0f} s (a day), not {duration_s:g} s."
        )
    if seed < 0:
        raise PaveTwinError(f"The seed must be a whole number from 0 up, not {seed}.")
    for path in routes:
        if not path.is_file():
            raise PaveTwinError(f"There is no routes file '{path}'.")
        if "," in str(path):
            raise PaveTwinError(f"SUMO cannot read a file with a comma in its name: '{path}'. Rename it.")


def _record(
    world: World,
    asked: Density | None,
    seed: int,
    duration_s: float,
    routes: Sequence[Path],
    inputs: str,
    path: Path,
    on_progress: OnProgress | None,
) -> Recording:
    require_sumo()
    capacity, frames = Capacity.of(world), frames_of(duration_s, sumo_run.STEP_S)
    begin_s = _first_departure_s(routes)
    _check_writable(path)
    with workplace() as folder:
        types = folder / "types.add.xml"
        types.write_text(sumo_types(), encoding="utf-8")
        job = sumo_run.Job(
            folder=str(folder),
            network=str(world.network_file.resolve()),
            additional=str(types),
            routes=[str(route.resolve()) for route in routes],
            seed=seed,
            sumo_seed=int(child(seed, Stream.TRAFFIC).integers(1, 2**31 - 1)),
            frames=frames,
            begin_s=begin_s,
            warm_up_s=(0.0, 0.0) if asked is None else WARM_UP_S,
            vehicles=capacity.vehicles(asked) if asked else 0,
            pedestrians=capacity.pedestrians(asked) if asked else 0,
        )
        outcome = run_job(job, on_progress)
        origin = Origin(
            world=world.content_hash,
            inputs=inputs,
            seed=seed,
            asked=asked,
            capacity=capacity,
            sumo_version=outcome.sumo_version,
            warm_up_s=outcome.start_s - begin_s,
        )
        return to_recording(folder, outcome, origin, frames)


def _kept(path: Path, inputs: str) -> Recording | None:
    """The recording at `path`, if it was made from the same inputs. A broken file is as good as none."""
    if not path.exists():
        return None
    try:
        recording = load_recording(path)
    except PaveTwinError:
        return None
    return recording if recording.origin.inputs == inputs else None


def _inputs(world: World, asked: Density | None, seed: int, routes: Sequence[Path]) -> str:
    """A hash of everything that shapes the traffic, but for its duration."""
    try:
        sumo = version("libsumo")
    except PackageNotFoundError:
        sumo = ""
    parts = {
        "behaviour": BEHAVIOUR,
        "world": world.content_hash,
        "network": _digest(world.network_file),
        "density": asdict(asked) if asked else None,
        "seed": seed,
        "routes": [_digest(path) for path in routes],
        "types": sumo_types(),
        "options": [sumo_run.STEP_S, *sumo_run.OPTIONS, *sumo_run.CLOSED_LOOP_OPTIONS, *WARM_UP_S],
        "loop": [closed_loop.TRIP_M, *closed_loop.WALK_M, closed_loop.GOALS, closed_loop.PATIENCE, closed_loop.FULL],
        "sumo": sumo,
    }
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def _digest(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise PaveTwinError(f"Cannot read '{path}': {error.strerror}.") from error


def _stem(path: Path) -> str:
    return path.name.removesuffix(".gz").removesuffix(".xml").removesuffix(".rou")


def _check_writable(path: Path) -> None:
    """Find out before minutes of simulation, not after."""
    folder = path.parent
    made = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=folder, prefix=".writable-")
        os.close(handle)
        Path(name).unlink()
    except OSError as error:
        raise unwritable(path, error) from error
    finally:
        if made:
            with suppress(OSError):
                folder.rmdir()


def _first_departure_s(routes: Sequence[Path]) -> float:
    """When a user's demand begins, in whole seconds: SUMO starts there and not at midnight."""
    times = []
    for path in routes:
        if path.suffix == ".gz":
            continue
        try:
            for _, element in ElementTree.iterparse(path):
                time = element.get("depart") or element.get("begin") or ""
                with suppress(ValueError):
                    times.append(_seconds(time))
                element.clear()
        except (ElementTree.ParseError, OSError) as error:
            raise PaveTwinError(f"The routes file '{path}' is not whole XML: {error}.") from error
    return float(math.floor(max(0.0, min(times, default=0.0))))


def _seconds(time: str) -> float:
    """SUMO's times: seconds, or [days:]hours:minutes:seconds."""
    total = 0.0
    for part, worth in zip(reversed(time.split(":")), (1, 60, 3600, 86400), strict=False):
        total += float(part) * worth
    return total
