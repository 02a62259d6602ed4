"""What is made of a mission when it is asked for: a page that plays without a server, a plan for a real drone, a
recording for rerun. The command line makes the same files.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from pavetwin.app.flights import again, descriptions
from pavetwin.app.kept import kept_world
from pavetwin.app.replay_page import replay_page
from pavetwin.app.rerun_file import is_installed, write_rerun
from pavetwin.app.street_map import packed_map
from pavetwin.app.task_report import TaskReport
from pavetwin.errors import PaveTwinError, no_such
from pavetwin.files import writing
from pavetwin.flightplan import PLAN_FORMATS, PlanLimits, check_limits, plan_of, save_plan
from pavetwin.flightplan.formats.plan_files import remark_on_parts
from pavetwin.mission.folder import MissionFolder
from pavetwin.mission.inputs import check_unchanged

HTML: Final = "html"
RRD: Final = "rrd"

_PLANS: Final = {
    "qgc": "QGroundControl (.plan)",
    "wpml": "DJI Pilot 2 (.kmz)",
    "litchi": "Litchi (.csv)",
    "csv": "a table of waypoints (.csv)",
}


def exports() -> list[dict[str, Any]]:
    """What can be made here: its name, in words, whether only of what can be flown again, and whether of one mission
    where several policies were flown."""
    made = [
        {
            "name": HTML,
            "words": "Page that plays offline (.html)",
            "of_missions": False,
            "of_one": False,
        }
    ]
    made += [
        {
            "name": name,
            "words": f"Flight plan: {_PLANS.get(name, name)}",
            "of_missions": True,
            "of_one": True,
        }
        for name in PLAN_FORMATS.names()
    ]
    if is_installed():
        made.append(
            {
                "name": RRD,
                "words": "Recording for rerun (.rrd)",
                "of_missions": True,
                "of_one": False,
            }
        )
    return made


def make_export(task: Mapping[str, Any], tell: TaskReport) -> Mapping[str, Any]:
    """Make one of them.

    Args:
        task: `what` by its name; `made`, the folder that gets it; `played`, the folder that plays the missions;
            `results`, that of the missions; `mission`, that of the one of which a plan is made; `world`.

    Returns:
        `files`, their names in that folder, and what is to be `told` of them.

    Raises:
        PaveTwinError: it cannot be made.
    """
    what, made, results = task["what"], Path(task["made"]), Path(task["results"])
    if what not in (known := [each["name"] for each in exports()]):
        raise PaveTwinError(no_such("kind of file", what[:40], known, key="`what`"))
    made.mkdir(parents=True, exist_ok=True)
    world = kept_world(Path(task["world"]))
    if what == HTML:
        tell(0.0, "Writing the page")
        name = f"{results.name}.html"
        with writing(made / "map.json.gz") as temporary:
            temporary.write_bytes(packed_map(world))
        with writing(made / name) as temporary:
            temporary.write_bytes(replay_page(Path(task["played"]), made / "map.json.gz", results.name))
        return {"files": [name], "told": "Plays in any browser, from the file alone."}
    if what == RRD:
        name = f"{results.name}.rrd"
        flown, _ = again(descriptions(results), world, tell)
        write_rerun(flown, made / name)
        return {"files": [name], "told": "Open it with `rerun`."}
    former = MissionFolder(task["mission"], other_policy=True)
    check_unchanged(former.spec.with_policy("baseline"), world)  # the track needs no file of its policy
    plan = plan_of(former, world)
    form = PLAN_FORMATS.get(what)(None)
    check_limits(plan, world, PlanLimits(None, 0.0, None), [form.most_waypoints])
    folder = made / f"plan-{former.spec.policy.name}-{what}"  # of its own: a plan replaces those of other formats
    files = save_plan(plan, folder, [form])
    told = " ".join(filter(None, [remark_on_parts(files), *plan.remarks]))
    return {
        "files": [str(file.relative_to(made)) for file in files],
        "told": f"{told} The pilot is responsible: check the plan, the airspace and the permits.".strip(),
    }
