"""The registry of policies, and the rules that every policy must keep.

Policies are compared on the same traffic. The comparison is fair only if an answer depends on nothing but the snapshot
and the settings, and a mission ends only if its policy does not wait forever."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import hypot, inf, isfinite, pi
from time import perf_counter
from types import MappingProxyType
from typing import Any

import numpy as np
from shapely import LineString, Polygon

from pavetwin.arrays import Float64Array
from pavetwin.config.mission import PolicySettings
from pavetwin.errors import describe
from pavetwin.plugins import find_class
from pavetwin.policies.policy import Action, Displace, GoOn, Policy, Revisit, Wait
from pavetwin.registry import Registry
from pavetwin.twin import (
    Agent,
    AgentClass,
    Confirmation,
    Episode,
    InspectionMemory,
    Mode,
    Note,
    Occlusion,
    Place,
    SegmentStatus,
    Snapshot,
    UavState,
)
from pavetwin.world.model import Segment

LONGEST_WAIT_S = 3600.0
FURTHEST_REVISIT_M = 1000.0
SLOWEST_S = 1.0
"""A decision is made a few hundred times a mission."""

SETTINGS = (
    PolicySettings(),
    PolicySettings(wait_s=0.1, max_wait_s=0.1, max_displacement_m=0.2, note_spacing_m=0.0, note_interval_s=0.0),
    PolicySettings(wait_s=60.0, max_wait_s=30.0, max_displacement_m=20.0, revisit_stay_s=0.5),
)


def check_policy(factory: Callable[[PolicySettings], Policy]) -> list[str]:
    """The rules that a policy breaks, each as a sentence; none for one that keeps them.

    It must answer every snapshot with an action of finite numbers within `settings`, the same one whenever it is asked
    the same, whatever it was asked before; it must change nothing that it is given, and stop waiting after
    `max_wait_s`. It reads no settings but those that it names in `reads`.
    """
    broken: list[str] = []
    for settings in SETTINGS:
        read: set[str] = set()
        try:
            first, second = factory(_watched(settings, read)), factory(settings)
        except Exception as error:
            return [f"it cannot be made from its settings: {describe(error)}"]
        cases = list(trial_snapshots(settings))
        answers = [_try(first, case, settings, broken) for case in cases]
        again = [_try(first, case, settings, broken) for case in cases]
        backwards = [_try(second, case, settings, broken) for case in reversed(cases)][::-1]
        for case, answer, others in zip(cases, answers, zip(again, backwards, strict=True), strict=True):
            if any(other != answer for other in others):
                broken.append(
                    f"with {case.name}, it answers {answer} once and "
                    f"{next(other for other in others if other != answer)} another time; "
                    "an answer must depend on the snapshot and the settings alone"
                )
        if unnamed := sorted(read - first.reads - {"options"}):
            broken.append(f"it reads {', '.join(unnamed)}, which its `reads` does not name")
    return list(dict.fromkeys(broken))


def _watched(settings: PolicySettings, read: set[str]) -> PolicySettings:
    """Copy of settings that adds the name of each setting it reads to `read`."""

    class Watched(PolicySettings):
        def __getattribute__(self, name: str) -> Any:
            if name in PolicySettings.model_fields:
                read.add(name)
            return super().__getattribute__(name)

    return Watched.model_construct(**dict(settings))


@dataclass(frozen=True)
class Case:
    """A synthetic moment and its special property."""

    name: str
    snapshot: Snapshot


def _try(policy: Policy, case: Case, settings: PolicySettings, broken: list[str]) -> Action | None:
    """The answer of a policy, with its faults added to `broken`."""
    before = _fingerprint(case.snapshot)
    begun = perf_counter()
    try:
        answer = policy.decide(case.snapshot)
    except Exception as error:
        broken.append(f"with {case.name}, it fails: {describe(error)}")
        return None
    if perf_counter() - begun > SLOWEST_S:
        broken.append(f"with {case.name}, it takes longer than {SLOWEST_S:g} s to decide")
    if _fingerprint(case.snapshot) != before:
        broken.append(f"with {case.name}, it changes the snapshot it was given")
    wrong = _wrong_with(answer, case.snapshot, settings)
    if wrong:
        broken.append(f"with {case.name}, it answers {answer!r}: {wrong}")
    return answer


def _wrong_with(answer: object, snapshot: Snapshot, settings: PolicySettings) -> str:
    match answer:
        case GoOn():
            return ""
        case Wait(seconds):
            occlusion = snapshot.occlusion
            if not 0 < seconds <= LONGEST_WAIT_S:
                return f"a wait must be above 0 and at most {LONGEST_WAIT_S:g} s"
            if occlusion is not None and occlusion.episode.waited_s >= settings.max_wait_s:
                return (
                    f"it has waited {occlusion.episode.waited_s:g} s already, and max_wait_s is {settings.max_wait_s:g}"
                )
            return ""
        case Displace(stay_s=stay_s):
            if not answer.length_m <= settings.max_displacement_m + 1e-6:
                return f"max_displacement_m is {settings.max_displacement_m:g}"
            return "" if 0 <= stay_s <= LONGEST_WAIT_S else f"a stay must be at most {LONGEST_WAIT_S:g} s"
        case Revisit((east, north), stay_s):
            away_m = hypot(east - snapshot.uav.position[0], north - snapshot.uav.position[1])
            if not (isfinite(away_m) and away_m <= FURTHEST_REVISIT_M):
                return f"a place to revisit must be at most {FURTHEST_REVISIT_M:g} m away"
            return "" if 0 < stay_s <= LONGEST_WAIT_S else f"a stay must be above 0 and at most {LONGEST_WAIT_S:g} s"
        case _:
            return "an answer must be GoOn, Wait, Displace or Revisit"


def _fingerprint(snapshot: Snapshot) -> str:
    """Everything that a snapshot holds, as text."""
    memory = snapshot.memory
    tables = (memory.surface_coverage, memory.status, memory.confirmed)
    bodies = (tuple(snapshot.agents), tuple(snapshot.parked))
    held = (*(sorted(table.items(), key=repr) for table in tables), memory.notes, bodies)
    return repr((snapshot, [segment.centre_line.wkt for segment in snapshot.segments], held))


# The moments.


@dataclass(frozen=True)
class _MadeUp:
    """Synthetic kernel view of a moment, in which visibility from a displaced place follows a simple formula."""

    present: tuple[Agent, ...]
    towards: Place
    """The visible share grows in this direction, by its length per metre."""
    reach_m: float = inf
    """Displacements further than this leave the flight domain."""

    def agents(self) -> Sequence[Agent]:
        return self.present

    def predict(self, displacements: Float64Array) -> Float64Array:
        shares = np.clip(displacements @ np.array(self.towards), 0.0, 1.0)
        return np.where(np.hypot(*displacements.T) <= self.reach_m, shares, -1.0)


def trial_snapshots(settings: PolicySettings) -> Iterator[Case]:
    """Moments of a mission over one straight street, ordinary and odd."""
    hidden = Occlusion(0.4, (31.0, 1.5), Episode(since_s=58.2))
    yield Case("a street half hidden", _snapshot(hidden))
    yield Case("nothing of the street seen", _snapshot(Occlusion(0.0, (30.0, 0.0), Episode(60.0))))
    yield Case("nothing under inspection", _snapshot(None, under_inspection=False))
    yield Case("no occlusion", _snapshot(None))
    yield Case("nothing hidden by an agent", _snapshot(Occlusion(0.69, None, Episode(60.0))))
    yield Case("no agents", _snapshot(hidden, agents=()))
    yield Case("many agents", _snapshot(hidden, agents=_crowd(300)))
    beside_parked = replace(hidden, permanently_hidden=0.45)
    yield Case("parked vehicles on both sides", _snapshot(beside_parked, parked=_rows_of_parked()))
    yield Case("no agents, parked vehicles alone", _snapshot(beside_parked, agents=(), parked=_rows_of_parked()))
    for share in (0.25, 0.5, 0.99, 1.0, 1.5):
        waited_s = share * settings.max_wait_s
        episode = Episode(60.0 - waited_s, waited_s)
        yield Case(f"{share:.0%} of max_wait_s waited", _snapshot(Occlusion(0.2, (30.0, 1.0), episode)))
    for flown_m in (0.0, 0.3, 3.0, 30.0):
        episode = Episode(40.0, 0.0, displacements=1, since_displacement_m=flown_m)
        yield Case(f"a displacement {flown_m:g} m ago", _snapshot(Occlusion(0.5, (32.0, -1.0), episode)))
    for name, towards, reach_m in (
        ("nothing to gain by moving", (0.0, 0.0), inf),
        ("more to see from the north", (0.0, 0.3), inf),
        ("more to see from the south-west", (-0.2, -0.2), inf),
        ("little room to move", (0.1, 0.2), 0.5),
        ("no room to move", (0.3, 0.0), 0.0),
    ):
        yield Case(name, _snapshot(hidden, towards=towards, reach_m=reach_m))
    near, far = Note((31.2, 1.5), 55.0, 5.0), Note((12.0, 1.5), 20.0, 5.0)
    yield Case("this place noted before", _snapshot(hidden, notes=(far, near)))
    yield Case("another place noted before", _snapshot(hidden, notes=(far,)))
    yield Case("a note made just now", _snapshot(hidden, notes=(Note((25.0, 1.5), 60.0, 5.0),)))
    yield Case("a battery almost empty", _snapshot(hidden, battery=0.01))
    yield Case("the very beginning", _snapshot(hidden, time_s=0.0))
    yield Case("a street far from the origin", _snapshot(hidden, at=(31_000.0, -42_000.0)))


def _snapshot(
    occlusion: Occlusion | None,
    *,
    under_inspection: bool = True,
    agents: tuple[Agent, ...] | None = None,
    parked: tuple[Agent, ...] = (),
    towards: Place = (0.0, 0.1),
    reach_m: float = inf,
    notes: tuple[Note, ...] = (),
    battery: float = 0.8,
    time_s: float = 60.0,
    at: Place = (30.0, 0.0),
) -> Snapshot:
    east, north = at[0] - 30.0, at[1]
    line = LineString([(east, north), (east + 60.0, north)])
    rim = [(0.0, -3.5), (60.0, -3.5), (60.0, 3.5), (0.0, 3.5)]
    segment = Segment("s", "street", ("e",), line, Polygon([(east + x, north + y) for x, y in rim]), 7.0, 2)
    if occlusion is not None and occlusion.hidden_place is not None:
        place = (occlusion.hidden_place[0] + east, occlusion.hidden_place[1] + north)
        occlusion = replace(occlusion, hidden_place=place)
    memory = InspectionMemory(
        surface_coverage=MappingProxyType({"s": 0.5}),
        status=MappingProxyType({"s": SegmentStatus.PENDING}),
        confirmed=MappingProxyType({3: Confirmation(41.0, on_revisit=False)}),
        notes=notes,
    )
    return Snapshot(
        time_s=time_s,
        segments=(segment,),
        uav=UavState(at, 10.0, 5.0, battery, 0.0, Mode.INSPECT),
        memory=memory,
        policy="tried",
        segment=segment if under_inspection else None,
        occlusion=occlusion,
        window_along_m=5.77,
        moment=_MadeUp(_crowd(2) if agents is None else agents, towards, reach_m),
        parked=parked,
    )


def _rows_of_parked() -> tuple[Agent, ...]:
    """Cars along both kerbs."""
    return tuple(
        Agent(2**31 + k, AgentClass.VEHICLE, (8.0 + 6.0 * k, north), (0.0, 0.0), 0.0, 4.5, 1.8, 1.5, is_parked=True)
        for north in (-2.5, 2.5)
        for k in range(8)
    )


def _crowd(count: int) -> tuple[Agent, ...]:
    """Cars and people in rows."""
    return tuple(
        Agent(k, AgentClass.VEHICLE, (25.0 + 5.0 * k, 1.5), (3.0, 0.0), 0.0, 4.5, 1.8, 1.5)
        if k % 2 == 0
        else Agent(k, AgentClass.PEDESTRIAN, (25.0 + 5.0 * k, -3.0), (0.0, 1.2), pi / 2, 0.5, 0.5, 1.75)
        for k in range(count)
    )


def _named(name: str, kind: type[Policy]) -> None:
    kind.name = name


POLICIES: Registry[type[Policy]] = Registry(
    "policy", key="policy", group="pavetwin.policies", home="pavetwin.policies", on_add=_named, rules=check_policy
)
policy = POLICIES.register
"""Register a policy under a name, which `policy` then takes."""


def policy_names() -> list[str]:
    """The registered policies, in the order of registration."""
    return POLICIES.names()


def load_policy(name: str, settings: PolicySettings) -> Policy:
    """The policy of a name, or a user's own as `path/to/file.py:ClassName`.

    Raises:
        PaveTwinError: as `policy_class`, or an option does not fit.
    """
    return policy_class(name)(settings)


def policy_class(name: str) -> type[Policy]:
    """A registered policy's class, or that of `path/to/file.py:ClassName`, once it has passed `check_policy`.

    Raises:
        PaveTwinError: it does not exist, its file defines no policy, or the policy breaks a rule.
    """
    kind = find_class(POLICIES, Policy, name)
    if "name" not in vars(kind):
        kind.name = kind.__name__  # not its base's: a changed hover is not hover
    return kind
