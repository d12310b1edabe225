"""What a metric environment is made of: its task, its maps, the true robot and the filter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from activeloc import checks
from activeloc.beliefs.settings import HistogramConfig, ParticleConfig
from activeloc.configuration import build, build_kind, unknown
from activeloc.envs.actions import Actions
from activeloc.envs.observations import ObservationConfig
from activeloc.envs.rewards import RewardWeights
from activeloc.envs.tasks import Task
from activeloc.errors import ConfigError
from activeloc.maps import MapSource
from activeloc.motion import MotionModel
from activeloc.sensors import BeamModel, LikelihoodField, ProximityModel, RangeSensor, Sonar

SENSORS = {
    "beam": BeamModel,
    "field": LikelihoodField,
    "proximity": ProximityModel,
    "sonar": Sonar,
}
BELIEFS = {"histogram": HistogramConfig, "particles": ParticleConfig}
WORLDS = ("continuous", "discrete")


@dataclass(frozen=True)
class EpisodeConfig:
    """Everything that defines an environment, typed and checked.

    Attributes:
        task: The problem.
        map: Where the maps come from.
        belief: Settings of the filter.
        sensor: The true sensor.
        motion: The true motion model.
        actions: What the robot can be told.
        reward: Weights of the reward's terms.
        observation: Resolution of the world view; whether there is an egocentric one.
        world: ``continuous``, or ``discrete``: the filter's own discretisation made true.
        filter_sensor: The sensor that the filter assumes; the true one if None.
        filter_motion: The motion model that the filter assumes; the true one if None.
        people: Probability that a beam is cut short by somebody who is not on the map. The filter
            is not told.
    """

    task: Task = field(default_factory=Task)
    map: MapSource = field(default_factory=lambda: MapSource.parse("office"))
    belief: HistogramConfig | ParticleConfig = field(default_factory=HistogramConfig)
    sensor: RangeSensor = field(default_factory=BeamModel)
    motion: MotionModel = field(default_factory=MotionModel)
    actions: Actions = field(default_factory=Actions)
    reward: RewardWeights = field(default_factory=RewardWeights)
    observation: ObservationConfig = field(default_factory=ObservationConfig)
    world: str = "continuous"
    filter_sensor: RangeSensor | None = None
    filter_motion: MotionModel | None = None
    people: float = 0.0

    @classmethod
    def build(cls, settings: Mapping[str, Any]) -> EpisodeConfig:
        """From the environment's keyword arguments: objects, mappings or names.

        Raises:
            ConfigError: If a name is unknown or a value is refused.
            MapError: If a map cannot be read.
        """
        known = [*cls.__dataclass_fields__]
        for name in settings:
            if name not in known:
                raise unknown("environment", name, known)
        given = {name: settings.get(name) for name in known}
        actions = given["actions"]
        if actions == "discrete+stay":
            actions = Actions(stay=True)
        elif isinstance(actions, str):
            actions = {"kind": actions}
        task = {"kind": given["task"]} if isinstance(given["task"], str) else given["task"]
        config = cls(
            task=build(Task, task, "task"),
            map=MapSource.parse(given["map"] if given["map"] is not None else "office"),
            belief=build_kind(BELIEFS, given["belief"], "belief", "histogram"),
            sensor=_sensor(given["sensor"], "sensor"),
            motion=build(MotionModel, given["motion"], "motion"),
            actions=build(Actions, actions, "actions"),
            reward=build(RewardWeights, given["reward"], "reward"),
            observation=build(ObservationConfig, given["observation"], "observation"),
            world="continuous" if given["world"] is None else given["world"],
            filter_sensor=None
            if given["filter_sensor"] is None
            else _sensor(given["filter_sensor"], "filter_sensor"),
            filter_motion=None
            if given["filter_motion"] is None
            else build(MotionModel, given["filter_motion"], "filter_motion"),
            people=0.0 if given["people"] is None else given["people"],
        )
        checks.choice("world", config.world, WORLDS)
        checks.number("people", config.people, 0.0, 1.0)
        if config.filter_sensor is not None and len(config.filter_sensor.bearings) != len(
            config.sensor.bearings
        ):
            raise ConfigError(
                f"filter_sensor must have the sensor's {len(config.sensor.bearings)} beams; "
                f"got {len(config.filter_sensor.bearings)}"
            )
        return config


def _sensor(value: object, where: str) -> RangeSensor:
    """A sensor as it was given, if it is one; otherwise one of the table, by name or fields."""
    if isinstance(value, RangeSensor) and not isinstance(value, type):
        return value
    sensor: RangeSensor = build_kind(SENSORS, value, where, "beam")
    return sensor
