"""Flies the mission of a scene in parts."""

from dataclasses import dataclass
from math import inf

from pavetwin._core import BatteryLow, Captured, Occluded
from pavetwin.mission.events import MissionEvent
from pavetwin.mission.mission import Event, Mission
from pavetwin.policies import load_policy
from pavetwin.sensing import load_sensor
from scenes.tiny import Scene


@dataclass
class Pilot:
    """Answers the events of a mission, as `fly` does."""

    scene: Scene
    policy: str

    def __post_init__(self) -> None:
        settings = self.scene.settings()
        self.events: list[MissionEvent] = []
        self.mission = Mission(
            self.scene.environment(settings),
            self.scene.traffic(),
            settings,
            list(range(len(self.scene.world.segments))),
            policy=self.policy,
            observer=self.events.append,
        )
        self._policy = load_policy(self.policy, settings.policy)
        self._sensor = load_sensor(settings.sensing, 0)

    def advance(self, until_s: float = inf) -> Mission:
        self.mission.advance_until(until_s, self.answer)
        return self.mission

    def answer(self, event: Event) -> None:
        match event:
            case Captured():
                self.mission.confirm(self._sensor.detect(self.mission.frame(event)))
            case Occluded():
                self.mission.act(self._policy.decide(self.mission.snapshot(event)))
            case BatteryLow():
                pass
