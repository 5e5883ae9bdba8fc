"""The true state of all objects, independent of the map. Only devices' actions and people change it; cognitive services read it."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field, replace

from somrs.entish.formula import Attribute, Comparison, Formula, Name, Relation, Truth, conjuncts
from verification.fault_runs.scenario import Scenario, Setting, floor_of

Place = tuple[str, str]
"""A relation (`isOn` or `isHeldBy`) and its second object."""

Placement = tuple[str, Place | bool]
"""An object and its place, or whether it is open."""


@dataclass(frozen=True, slots=True)
class Action:
    """A change of the true state. `task` is the task that the device worked for; None for a person or no task."""

    at: float
    object: str
    state_before: Place | bool
    state_after: Place | bool
    task: str | None
    actor: str


@dataclass
class Reality:
    """The true places of things and states of doors, with all changes so far."""

    places: dict[str, Place] = field(default_factory=dict)
    open: dict[str, bool] = field(default_factory=dict)
    shelf_doors: dict[str, str] = field(default_factory=dict)
    """The door in front of each shelf."""
    actions: list[Action] = field(default_factory=list)
    weights: dict[str, float] = field(default_factory=dict)
    """Of each thing, in kg, if the map has none."""
    unnamed: set[str] = field(default_factory=set)
    """Things that the map does not have. They get the names that the Repository gives them."""
    tables: tuple[str, ...] = ()
    floors: dict[str, str] = field(default_factory=dict)
    """Where a device drops things, by its name."""
    reserved: set[tuple[str, str]] = field(default_factory=set)
    """The tables that devices have reserved, each with its thing."""
    doubtful: set[str] = field(default_factory=set)
    """Objects that the map may have wrong: a report was false, or a person moved them without a report."""

    @classmethod
    def from_scenario(cls, scenario: Scenario) -> Reality:
        places = {thing: ("isOn", place) for thing, place in (*scenario.things, *scenario.hidden)}
        shelf_doors = dict(scenario.shelves) if scenario.setting is Setting.DOORS else {}
        hidden = {thing for thing, _ in scenario.hidden}
        return cls(
            places=places,
            open=dict(scenario.doors),
            shelf_doors=shelf_doors,
            weights=dict(scenario.weights),
            unnamed=hidden,
            tables=scenario.tables,
            floors={device.name: floor_of(scenario.map_number(device.name)) for device in scenario.devices},
        )

    def state(self, object: str) -> Place | bool:
        return self.open[object] if object in self.open else self.places[object]

    def situation_of(self, object: str) -> str:
        """Return the object's situation in Entish."""
        if object in self.open:
            return f"{object}.Open = {'TRUE' if self.open[object] else 'FALSE'}"
        relation, place = self.places[object]
        return f"{object} {relation} {place}"

    def things_on(self, place: str) -> list[str]:
        return [thing for thing, state in self.places.items() if state == ("isOn", place)]

    def name(self, thing: str, name: str) -> None:
        """The thing has this name on the map from now on."""
        self.unnamed.discard(thing)
        self.places[name] = self.places.pop(thing)
        self.weights |= {name: self.weights.pop(thing)} if thing in self.weights else {}
        self.actions = [replace(action, object=name) if action.object == thing else action for action in self.actions]
        if thing in self.doubtful:
            self.doubtful.add(name)

    def reserve_table(self, thing: str) -> str:
        """Reserve one table after the other."""
        table = self.tables[len(self.reserved) % len(self.tables)]
        self.reserved.add((table, thing))
        return table

    def reachable(self, place: str) -> bool:
        """Whether the place is accessible: it has no door, or its door is open."""
        return self.open.get(self.shelf_doors.get(place, ""), True)

    def move_object(self, object: str, target: Place | bool, time: float, task: str | None, actor: str) -> None:
        state_before = self.state(object)
        if state_before == target:
            return
        if isinstance(target, bool):
            self.open[object] = target
        else:
            self.places[object] = target
        self.actions.append(Action(time, object, state_before, target, task, actor))

    def drop_all(self, device: str, time: float, at_work_on: Collection[str]) -> None:
        """Let everything that the device holds fall. Objects that it does not work on become doubtful, as no report will mention them."""
        for thing, place in self.places.items():
            if place == ("isHeldBy", device):
                if thing not in at_work_on:
                    self.doubtful.add(thing)
                self.move_object(thing, ("isOn", self.floors[device]), time, None, device)

    def is_true(self, formula: Formula) -> bool:
        """Whether the formula holds, as far as it concerns places and doors."""
        return all(self.state(object) == state for object, state in placements(formula) if object in self.places or object in self.open)


def placements(formula: Formula) -> Iterator[Placement]:
    """Yield the formula's statements about places and doors."""
    for part in conjuncts(formula):
        match part:
            case Relation(("isOn" | "isHeldBy") as relation, (Name(thing), Name(place))):
                yield thing, (relation, place)
            case Comparison(Attribute(Name(door), "Open"), "=", Truth(is_open)):
                yield door, is_open
