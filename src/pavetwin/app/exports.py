"""Exports of missions: plans for drones, a page that plays offline, a recording for Rerun."""

import re
from base64 import b64encode
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from importlib import import_module
from importlib.util import find_spec
from json import dumps
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely

from pavetwin.app.flights import again, descriptions
from pavetwin.app.session_cache import kept_world
from pavetwin.app.street_map import packed_map
from pavetwin.app.task_process import TaskReport
from pavetwin.arrays import Float64Array
from pavetwin.draw.mission_marks import outcomes
from pavetwin.draw.mission_style import AGENT_COLOURS, agent_group
from pavetwin.draw.style import OUTCOME_COLOURS
from pavetwin.errors import PaveTwinError, no_such
from pavetwin.files import writing
from pavetwin.flightplan import PLAN_FORMATS, PlanLimits, check_limits, plan_of, save_plan
from pavetwin.flightplan.formats.plan_files import remark_on_parts
from pavetwin.mission.environment import MissionEnvironment
from pavetwin.mission.folder import MissionFolder
from pavetwin.mission.inputs import check_unchanged
from pavetwin.mission.result import MissionResult
from pavetwin.mission.timeline import Timeline

STATIC: Final = Path(__file__).parent / "static"

LARGEST_BYTES: Final = 60_000_000
"""Largest size of a file; larger ones take browsers many seconds to open."""

ENTRY: Final = "replay.js"
INSTEAD: Final = {"server.js": "inlined.js"}
"""Modules that stand in for others where there is no server."""

POLICY: Final = "; ".join(
    (
        "default-src 'none'",
        "script-src 'unsafe-inline' data:",
        "style-src 'unsafe-inline'",
        "img-src data:",
        "base-uri 'none'",
        "form-action 'none'",
    )
)

_IMPORT: Final = re.compile(r"""(\bfrom\s*)(['"])\./([\w.-]+\.js)\2""")
_STYLE: Final = re.compile(r'<link rel="stylesheet" href="static/([\w.-]+)">')
_ICON: Final = re.compile(r'href="static/([\w.-]+\.svg)"')
_SCRIPT: Final = '<script type="module" src="static/main.js"></script>'


def replay_page(played: Path, map_file: Path, name: str) -> bytes:
    """The page of what `write_playback` wrote.

    Args:
        played: its folder.
        map_file: the world's map, gzipped JSON (`pavetwin.app.street_map.packed_map`).
        name: of the missions, for the title.

    Raises:
        PaveTwinError: it would be larger than `LARGEST_BYTES`.
    """
    held = {f"api/played/replay/{path.name}": path for path in sorted(played.glob("*.gz"))} | {"map": map_file}
    files = "\n".join(
        f'<script type="application/gzip" data-file="{place}">{_base64(path.read_bytes())}</script>'
        for place, path in held.items()
    )
    imports = {f"pavetwin/{module}": _url("text/javascript", text) for module, text in _modules()}
    script = (
        f'<script type="importmap">{dumps({"imports": imports})}</script>\n{files}\n'
        f'<script type="module">import "pavetwin/{ENTRY}";</script>'
    )
    page = (STATIC / "index.html").read_text(encoding="utf-8")
    page = _STYLE.sub(lambda found: f"<style>{_text(found[1])}</style>", page)
    page = _ICON.sub(lambda found: f'href="{_url("image/svg+xml", _text(found[1]))}"', page)
    head = (
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        f'<meta name="pavetwin-mission" content="{escape(name)}">\n'
        f"<!--\n{_text('vendor-licences.txt')}\n-->"
    )
    page = page.replace('<meta charset="utf-8">', f'<meta charset="utf-8">\n{head}', 1).replace(_SCRIPT, script, 1)
    content = page.encode()
    if len(content) > LARGEST_BYTES:
        raise PaveTwinError(
            f"The page would have {len(content) / 1e6:.0f} MB, and browsers take up to {LARGEST_BYTES / 1e6:.0f} MB "
            "well; fly fewer segments, or traffic on fewer streets (`traffic_area`)."
        )
    return content


def _modules() -> Iterator[tuple[str, str]]:
    """The modules that the page needs, each with its imports named as the import map has them."""
    waiting, known = [ENTRY], {ENTRY}
    while waiting:
        name = waiting.pop()
        text = _text(INSTEAD.get(name, name))
        for found in _IMPORT.finditer(text):
            if found[3] not in known:
                known.add(found[3])
                waiting.append(found[3])
        yield name, _IMPORT.sub(r"\1\2pavetwin/\3\2", text)


def _text(name: str) -> str:
    return (STATIC / name).read_text(encoding="utf-8")


def _url(kind: str, text: str) -> str:
    return f"data:{kind};base64,{_base64(text.encode())}"


def _base64(content: bytes) -> str:
    return b64encode(content).decode()


PACKAGE: Final = "rerun-sdk"

EVERY_S: Final = 0.5
"""Between two moments that are recorded."""

CLOCK: Final = "mission"
"""The timeline of rerun on which everything lies: seconds since take-off."""


def is_installed() -> bool:
    """Whether the package for recordings is installed."""
    return find_spec("rerun") is not None


def check_installed() -> None:
    """Raises:
    PaveTwinError: rerun is not installed.
    """
    if not is_installed():
        raise PaveTwinError(f"Recordings for rerun (.rrd) need its package: `pip install {PACKAGE}`.")


def write_rerun(results: Sequence[MissionResult], path: Path) -> None:
    """Write missions over the same traffic as one recording: the streets, the traffic, and of each policy the UAV, its
    track, visibility, battery, and the defects by what became of them.

    Raises:
        PaveTwinError: rerun is not installed, or the file cannot be written.
    """
    check_installed()
    rerun = import_module("rerun")
    recording = rerun.RecordingStream("pavetwin")
    with writing(path) as temporary:
        recording.save(str(temporary))
        _write_town(rerun, recording, results[0].environment)
        longest = max(results, key=lambda result: result.duration_s)
        _write_traffic(rerun, recording, longest)
        for result in results:
            _write_mission(rerun, recording, result)
        recording.flush()
        del recording  # closes the file


def _write_town(rerun: Any, recording: Any, environment: MissionEnvironment) -> None:
    world = environment.world
    lines = [_level(part.exterior.coords) for part in _polygons(world.carriageway)]
    recording.log("town/carriageway", rerun.LineStrips3D(lines), static=True)
    roofs = [
        _level(part.exterior.coords, building.height_m)
        for building in world.buildings
        for part in _polygons(building.polygon)
    ]
    recording.log("town/roofs", rerun.LineStrips3D(roofs), static=True)
    parked = environment.parked_agents
    recording.log(
        "town/parked",
        _boxes(
            rerun,
            np.array([[*agent.position, agent.yaw_rad] for agent in parked]).reshape(-1, 3),
            np.array([[agent.length_m, agent.width_m, agent.height_m] for agent in parked]).reshape(-1, 3),
            [AGENT_COLOURS["parked"]] * len(parked),
        ),
        static=True,
    )


def _write_traffic(rerun: Any, recording: Any, result: MissionResult) -> None:
    trace = result.trace
    for time_s in np.arange(0.0, min(result.duration_s, trace.duration_s), EVERY_S).tolist():
        poses = trace.agents_at(time_s)
        sizes = np.column_stack([poses["length_m"], poses["width_m"], poses["height_m"]]).astype(np.float64)
        groups = [
            agent_group(length, height, bool(walks))
            for (length, _, height), walks in zip(sizes.tolist(), poses["is_pedestrian"].tolist(), strict=True)
        ]
        places = np.column_stack([poses["x_m"], poses["y_m"], poses["yaw_rad"]])
        recording.set_time(CLOCK, duration=time_s)
        recording.log("traffic", _boxes(rerun, places, sizes, [AGENT_COLOURS[group] for group in groups]))


def _write_mission(rerun: Any, recording: Any, result: MissionResult) -> None:
    timeline, name = Timeline(result), result.policy
    track = timeline.track
    line = np.column_stack([track["x_m"], track["y_m"], track["altitude_m"]])
    recording.log(f"{name}/track", rerun.LineStrips3D([line]), static=True)
    for time_s in np.arange(0.0, timeline.duration_s, EVERY_S).tolist():
        state = timeline.at(time_s)
        recording.set_time(CLOCK, duration=time_s)
        recording.log(f"{name}/uav", rerun.Points3D([[*state.uav.position, state.uav.altitude_m]], radii=[0.4]))
        recording.log(f"{name}/battery", rerun.Scalars(state.uav.battery))
        recording.log(f"{name}/found", rerun.Scalars(float(len(state.found))))
        if state.visibility is not None:
            recording.log(f"{name}/visibility", rerun.Scalars(state.visibility))
    judged = outcomes(result)
    defects = [result.environment.defects[number] for number in judged]
    recording.log(
        f"{name}/defects",
        rerun.Points3D(
            [[defect.centre.x, defect.centre.y, 0.0] for defect in defects],
            colors=[OUTCOME_COLOURS[outcome.value] for outcome in judged.values()],
            labels=[f"{defect.kind} {defect.id}: {judged[defect.id].value}" for defect in defects],
            show_labels=False,
            radii=0.3,
        ),
        static=True,
    )


def _boxes(rerun: Any, places: Float64Array, sizes: Float64Array, colours: list[str]) -> Any:
    """Bodies that stand on the ground.

    Args:
        places: (n, 3) east, north, yaw.
        sizes: (n, 3) length, width, height.
    """
    zero = np.zeros(len(places))
    centres = np.column_stack([places[:, 0], places[:, 1], sizes[:, 2] / 2])
    turns = np.column_stack([zero, zero, np.sin(places[:, 2] / 2), np.cos(places[:, 2] / 2)])
    return rerun.Boxes3D(centers=centres, half_sizes=sizes / 2, quaternions=turns, colors=colours)


def _polygons(shape: Any) -> list[Any]:
    return [part for part in shapely.get_parts(shape) if part.geom_type == "Polygon"]


def _level(points: Any, height_m: float = 0.0) -> Float64Array:
    flat = np.asarray(points, dtype=np.float64)[:, :2]
    return np.column_stack([flat, np.full(len(flat), height_m)])


HTML: Final = "html"
RRD: Final = "rrd"

_PLANS: Final = {
    "qgc": "QGroundControl (.plan)",
    "wpml": "DJI Pilot 2 (.kmz)",
    "litchi": "Litchi (.csv)",
    "csv": "a table of waypoints (.csv)",
}


def exports() -> list[dict[str, Any]]:
    """Available exports: name, description, whether the mission must be flown again, and whether of one mission
    where several policies were flown."""
    offered = [(HTML, "Page that plays offline (.html)", False, False)]
    offered += [(name, f"Flight plan: {_PLANS.get(name, name)}", True, True) for name in PLAN_FORMATS.names()]
    if is_installed():
        offered.append((RRD, "Recording for rerun (.rrd)", True, False))
    return [dict(zip(("name", "words", "of_missions", "of_one"), each, strict=True)) for each in offered]


def make_export(task: Mapping[str, Any], report: TaskReport) -> Mapping[str, Any]:
    """Make one of them.

    Args:
        task: `what` by its name; `made`, the folder that gets it; `played`, the folder that plays the missions;
            `results`, that of the missions; `mission`, that of the one of which a plan is made; `world`.

    Returns:
        `files`, their names in that folder, and a `remark`.

    Raises:
        PaveTwinError: it cannot be made.
    """
    what, made, results = task["what"], Path(task["made"]), Path(task["results"])
    if what not in (known := [each["name"] for each in exports()]):
        raise PaveTwinError(no_such("kind of file", what[:40], known, key="`what`"))
    made.mkdir(parents=True, exist_ok=True)
    world = kept_world(Path(task["world"]))
    if what == HTML:
        report(0.0, "Writing the page")
        name = f"{results.name}.html"
        with writing(made / "map.json.gz") as temporary:
            temporary.write_bytes(packed_map(world))
        with writing(made / name) as temporary:
            temporary.write_bytes(replay_page(Path(task["played"]), made / "map.json.gz", results.name))
        return {"files": [name], "remark": "Plays in any browser, from the file alone."}
    if what == RRD:
        name = f"{results.name}.rrd"
        flown, _ = again(descriptions(results), world, report)
        write_rerun(flown, made / name)
        return {"files": [name], "remark": "Open it with `rerun`."}
    former = MissionFolder(task["mission"], other_policy=True)
    check_unchanged(former.spec.with_policy("baseline"), world)  # the track needs no file of its policy
    plan = plan_of(former, world)
    form = PLAN_FORMATS.get(what)(None)
    check_limits(plan, world, PlanLimits(None, 0.0, None), [form.most_waypoints])
    folder = made / f"plan-{former.spec.policy.name}-{what}"  # of its own: a plan replaces those of other formats
    files = save_plan(plan, folder, [form])
    remarks = " ".join(filter(None, [remark_on_parts(files), *plan.remarks]))
    return {
        "files": [str(file.relative_to(made)) for file in files],
        "remark": f"{remarks} The pilot is responsible: check the plan, the airspace and the permits.".strip(),
    }
