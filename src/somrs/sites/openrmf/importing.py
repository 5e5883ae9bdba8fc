"""Imports a building file of Open-RMF's traffic editor: which parts are read, and in which order."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from somrs.errors import InputError, ModelError, Problem
from somrs.ontology.files.nodes import Source
from somrs.ontology.types import Value
from somrs.sites.draft import Draft, identifier
from somrs.sites.notes import Rank
from somrs.sites.openrmf.crowds import add_crowds, note_crowds
from somrs.sites.openrmf.document import Document, name_text, number
from somrs.sites.openrmf.fabric import add_fabric, add_lifts
from somrs.sites.openrmf.furniture import add_models
from somrs.sites.openrmf.lanes import add_lanes, add_robots, add_waypoints, reserve_names
from somrs.sites.openrmf.levels import Coordinates, Level
from somrs.sites.site import ImportOptions, Site


def import_building(path: str | Path, options: ImportOptions | None = None) -> Site:
    """The building in the file. Raises InputError for an unreadable file, and ModelError for wrong content."""
    try:
        text = Path(path).read_text("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path} cannot be read ({error}); give the path of an Open-RMF .building.yaml file") from error
    return import_text(text, str(path), options)


def import_text(text: str, file: str = "building.yaml", options: ImportOptions | None = None) -> Site:
    """The building in the text. Raises ModelError for wrong content."""
    source = Source(file, text)
    if source.problems:
        raise ModelError(source.problems)
    if not isinstance(source.data, dict) or not isinstance(source.data.get("levels"), dict) or not source.data["levels"]:
        message = "an Open-RMF building has levels: with at least one level; is this a .building.yaml file?"
        raise ModelError([Problem(file=file, line=1, subject="file", rule="structure", message=message)])
    if _is_navigation_graph(source.data):
        message = "this is a navigation graph, without walls and robots; import the .building.yaml file that it was made from"
        raise ModelError([Problem(file=file, line=1, subject="file", rule="structure", message=message)])
    return _Import(Document(source), options or ImportOptions()).building()


def _is_navigation_graph(data: dict[str, Any]) -> bool:
    """Whether vertices have their names among their parameters, as in the files that building_map_generator writes."""
    levels = [level for level in data["levels"].values() if isinstance(level, dict)]
    vertices = [vertex for level in levels if isinstance(level.get("vertices"), list) for vertex in level["vertices"]]
    return bool(vertices) and all(isinstance(vertex, list) and len(vertex) == 3 and isinstance(vertex[2], dict) for vertex in vertices)


_SECTIONS = frozenset((
    "name", "building_name", "version", "coordinate_system", "reference_level_name", "parameters", "levels", "lifts", "graphs", "crowd_sim",
))  # fmt: skip
"""What the traffic editor writes for a building (`building.cpp` of rmf_traffic_editor)."""
_SECTIONS_OF_LEVELS = frozenset((
    "drawing", "x_meters", "y_meters", "elevation", "vertices", "measurements", "fiducials", "features", "constraints", "layers", "walls",
    "doors", "floors", "holes", "models", "lanes", "human_lanes",
))  # fmt: skip
"""The same for a level (`level.cpp`). Of these, features, constraints and layers serve to align drawings."""


class _Import:
    """One import: the document that is read, and the map that is made of it."""

    def __init__(self, document: Document, options: ImportOptions) -> None:
        self.document, self.options, self.draft = document, options, Draft()

    def building(self) -> Site:
        data = self.document.data
        name = identifier(name_text(data.get("name") or data.get("building_name") or "Building"))
        levels: list[Level] = []
        with self.document.reading("coordinate system", ("coordinate_system",)):
            coordinates = Coordinates(self.document, self.draft.notes)
            building = self.draft.add(name, "Building", self._reference_point(coordinates))
            levels = [level for key in data["levels"] if (level := self._level(key, building, coordinates)) is not None]
            if not self.document.problems:
                coordinates.align(levels)
        if not self.document.problems:
            self._fill(levels, name)
        if self.document.problems:
            raise ModelError(self.document.problems)
        return self.draft.site(name, self.document.source.file)

    def _level(self, key: Any, building: str, coordinates: Coordinates) -> Level | None:
        data: dict[str, Any] = self.document.data["levels"][key]
        name = name_text(key)
        with self.document.reading(f"level {name}", ("levels", name)):
            elevation = number(data.get("elevation", 0.0))
            if "elevation" not in data and len(self.document.data["levels"]) > 1:
                self.draft.notes.add(Rank.ASSUMED, f"level {name}", "has no elevation; 0 is taken")
            level = Level(name, data, "", elevation, coordinates.metres(name, data))
            self._check_vertices(level)
            level.storey = self.draft.add(self.draft.fresh(identifier(name)), "Storey", {"Elevation": elevation}, building)
            return level
        return None

    def _check_vertices(self, level: Level) -> None:
        for index, vertex in enumerate(level.data.get("vertices") or ()):
            with self.document.reading(f"vertex {index + 1} of {level.name}", ("levels", level.name, "vertices", index)):
                level.metres(number(vertex[0]), number(vertex[1]))

    def _reference_point(self, coordinates: Coordinates) -> dict[str, Value]:
        """What the origin of the map is on Earth, for a building with geographic coordinates."""
        projection = coordinates.projection
        if projection is None:
            return {}
        text = "the coordinates are projected to metres; Latitude and Longitude of the building say where the origin is"
        self.draft.notes.add(Rank.KEPT, f"{projection.latitude:.5f}, {projection.longitude:.5f}", text)
        return {"Latitude": projection.latitude, "Longitude": projection.longitude}

    def _note_unknown(self, levels: list[Level]) -> None:
        """What other tools have written into the file is not on the map."""
        parts = [("the building", self.document.data, _SECTIONS), *(("levels", level.data, _SECTIONS_OF_LEVELS) for level in levels)]
        for owner, data, sections in parts:
            for key in data:
                if data[key] and key not in sections:
                    self.draft.notes.add(Rank.LEFT_OUT, name_text(key), f"parts of {owner} that SO-MRS does not know")

    def _fill(self, levels: list[Level], building: str) -> None:
        document, draft, options = self.document, self.draft, self.options
        self._note_unknown(levels)
        for level in levels:
            with document.reading(f"level {level.name}", ("levels", level.name)):
                reserve_names(draft, level)
        for level in levels:
            with document.reading(f"level {level.name}", ("levels", level.name)):
                add_fabric(document, draft, level)
        lifts: dict[str, str] = {}
        with document.reading("lifts", ("lifts",)):
            lifts = add_lifts(document, draft, levels, building)
        for level in levels:
            with document.reading(f"level {level.name}", ("levels", level.name)):
                add_models(document, draft, level, options.models)
                add_waypoints(document, draft, level, lifts, crowds=options.crowds)
                add_lanes(document, draft, level, crowds=options.crowds)
                add_robots(document, draft, level, options.models)
        if options.crowds:
            add_crowds(document, draft, levels)
        else:
            note_crowds(document, draft, levels)
