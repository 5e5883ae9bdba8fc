"""Surveys of a building for traffic: its roadmap, and what of it is closed. The work takes seconds for a large building."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from msgspec import Struct

from somrs.ontology.map import Map
from somrs.ontology.modes import closed_passages
from somrs.ontology.types import Ontology
from somrs.space.clearance import Disc
from somrs.space.dimensions import dimensions_of
from somrs.space.free_space import FreeSpace
from somrs.space.lanes import lanes_of
from somrs.space.shafts import Shaft, shafts_of
from somrs.space.solids import Role, Solid, solid_of
from somrs.space.zones import zones_of
from somrs.traffic.layout import OpenBuilding, connected_levels, kinds_with_places, lay_out
from somrs.traffic.notices import CloseWays
from somrs.traffic.obstructions import Obstructions, discs_along
from somrs.traffic.roadmap import Roadmap, RobotKind, numbered
from somrs.traffic.state import Position

NEAR_FLOOR = 0.3
"""Things whose underside is less than this above a floor stand in the way there, m."""
PASSING = (Role.IGNORED, Role.MARK, Role.PART, Role.CAMERA, Role.THING, Role.ROBOT)
"""What is no part of the building."""


class Survey(Struct, frozen=True, kw_only=True):
    """The building is to be surveyed as it is on this map. `present`: the robots that take part in traffic, which keep out of each other's
    way; `astray`: where others may be (see `TrafficState`)."""

    map: Map
    ontology: Ontology
    present: tuple[str, ...] = ()
    astray: tuple[tuple[Position, ...], ...] = ()


class Surveyed(Struct, frozen=True, kw_only=True, tag=True):
    """The roadmap, and what of it is closed now."""

    roadmap: Roadmap
    closing: CloseWays


class Surveyor:
    """Surveys a building again and again, and does only the work that a change needs."""

    def __init__(self) -> None:
        self._layout: object = None
        """What the roadmap follows from."""
        self._spaces_of: object = None
        """What the free spaces follow from."""
        self._use(Roadmap(places=(), lanes=()))

    def _use(self, roadmap: Roadmap) -> None:
        self._roadmap = roadmap
        self._obstructions = Obstructions(numbered(roadmap))
        self._spaces: dict[float, FreeSpace] = {}

    def survey(self, survey: Survey) -> Surveyed:
        map, ontology = survey.map, survey.ontology
        solids = [solid for object in map.objects.values() if (solid := solid_of(object, ontology)) is not None]
        robots = [solid for solid in solids if solid.role is Role.ROBOT]
        building = tuple(solid for solid in solids if solid.role not in PASSING)
        shafts = tuple(shaft for shaft in shafts_of(map, ontology) if shaft.landings)
        self._lay_out(survey, robots, building, shafts)
        if self._spaces_of != (building, shafts):
            self._spaces_of = building, shafts
            self._spaces = {level: FreeSpace(map, ontology, level=level) for level in self._obstructions.levels}
        standing = {level: [*_standing(survey, solids, level)] for level in self._obstructions.levels}
        closed = {*closed_passages(map, ontology)}
        passages = [solid for solid in building if solid.name in closed]
        occupied_lifts = {position.zone for positions in survey.astray for position in positions if position.zone is not None}
        forbidden = zones_of(map, ontology).forbidden
        closing = self._obstructions.closing(self._spaces, standing, passages, forbidden, sorted(occupied_lifts))
        return Surveyed(roadmap=self._roadmap, closing=closing)

    def _lay_out(self, survey: Survey, robots: Sequence[Solid], building: Sequence[Solid], shafts: Sequence[Shaft]) -> None:
        kinds = {RobotKind(dimensions_of(robot).radius, robot.graph) for robot in robots}
        lanes = lanes_of(survey.map, survey.ontology)
        levels = connected_levels((robot.z for robot in robots), shafts)
        opened = tuple(replace(solid, open=True) if solid.role is Role.DOOR else solid for solid in building)
        layout = (opened, shafts, kinds_with_places(kinds, lanes), lanes, levels) if robots else None
        if layout != self._layout:
            self._layout, self._spaces_of = layout, None
            empty = Roadmap(places=(), lanes=())
            self._use(lay_out(OpenBuilding(survey.map, survey.ontology, levels, lanes), kinds) if layout is not None else empty)


def _standing(survey: Survey, solids: Sequence[Solid], level: float) -> Iterator[Disc]:
    """What stands on the floor of a height and is no part of the building: things, and robots that do not take part."""
    for solid in solids:
        is_robot = solid.role is Role.ROBOT and solid.name not in survey.present
        if (is_robot or solid.role is Role.THING) and -0.1 < solid.z - level < NEAR_FLOOR:
            yield Disc(solid.x, solid.y, dimensions_of(solid).radius if is_robot else solid.extent)
    for positions in survey.astray:
        yield from (disc for height, disc in discs_along(positions) if height == level)
