"""Where everything really is, whatever the map says. Only devices' real actions and people change it; cognitive devices read it."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field

from somrs.entish.formula import Attribute, Comparison, Formula, Name, Relation, Truth, conjuncts
from verification.fault_runs.site import FLOOR
from verification.fault_runs.story import Setting, Story

Place = tuple[str, str]
"""How a thing is where it is: `isOn` or `isHeldBy`, and what."""

Part = tuple[str, Place | bool]
"""An object, and where it is, or whether it is open."""


@dataclass(frozen=True, slots=True)
class Deed:
    """A change of the truth. `task` is whose device did it; None: a person, or nobody."""

    at: float
    object: str
    before: Place | bool
    after: Place | bool
    task: str | None
    who: str


@dataclass
class Reality:
    """The things and the doors as they are, and how they came to be so."""

    where: dict[str, Place] = field(default_factory=dict)
    open: dict[str, bool] = field(default_factory=dict)
    behind: dict[str, str] = field(default_factory=dict)
    """Shelf and door."""
    deeds: list[Deed] = field(default_factory=list)
    doubtful: set[str] = field(default_factory=set)
    """Objects that the map may be wrong about: somebody lied about them, or moved them in secret."""

    @classmethod
    def of(cls, story: Story) -> Reality:
        where = {thing: ("isOn", place) for thing, place in story.things}
        behind = dict(story.shelves) if story.setting is Setting.DOORS else {}
        return cls(where=where, open=dict(story.doors), behind=behind)

    def state(self, object: str) -> Place | bool:
        return self.open[object] if object in self.open else self.where[object]

    def said(self, object: str) -> str:
        """How it is, in Entish."""
        if object in self.open:
            return f"{object}.Open = {'TRUE' if self.open[object] else 'FALSE'}"
        relation, place = self.where[object]
        return f"{object} {relation} {place}"

    def reachable(self, place: str) -> bool:
        """Whether one gets there: the door before it is open."""
        return self.open.get(self.behind.get(place, ""), True)

    def put(self, object: str, to: Place | bool, at: float, task: str | None, who: str) -> None:
        before = self.state(object)
        if before == to:
            return
        if isinstance(to, bool):
            self.open[object] = to
        else:
            self.where[object] = to
        self.deeds.append(Deed(at, object, before, to, task, who))

    def drop_all(self, device: str, at: float, at_work_on: Collection[str]) -> None:
        """Whatever it holds falls. Of what it does not work on, nobody is to know."""
        for thing, place in self.where.items():
            if place == ("isHeldBy", device):
                if thing not in at_work_on:
                    self.doubtful.add(thing)
                self.put(thing, ("isOn", FLOOR), at, None, device)

    def is_so(self, formula: Formula) -> bool:
        """Whether it is so, as far as it speaks of what can change."""
        return all(self.state(object) == state for object, state in parts(formula) if object in self.where or object in self.open)


def parts(formula: Formula) -> Iterator[Part]:
    """What a formula says of places and doors."""
    for part in conjuncts(formula):
        match part:
            case Relation(("isOn" | "isHeldBy") as relation, (Name(thing), Name(place))):
                yield thing, (relation, place)
            case Comparison(Attribute(Name(door), "Open"), "=", Truth(is_open)):
                yield door, is_open
