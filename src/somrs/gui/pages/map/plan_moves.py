"""What a user moves on the floor plan: the changes of the map, made one after the other, and the answers to the plan."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from somrs.api.remote import LiveApi
from somrs.errors import SomrsError
from somrs.gui.author import author
from somrs.gui.components.floorplan import FloorPlan
from somrs.gui.pages.map.moves import Move, move_changes, shape_changes
from somrs.gui.pages.map.refusals import overtaken_objects, refusal_text
from somrs.gui.shell import notify
from somrs.ontology.map import Map
from somrs.ontology.objects import Change
from somrs.protocol.messages.knowledge import UpdateMap


class PlanMoves:
    """The moves on one plan. `record_version` is called with each version that they make."""

    def __init__(self, api: LiveApi, plan: FloorPlan, record_version: Callable[[int], None]) -> None:
        self._api, self._plan, self._record_version = api, plan, record_version
        self._last_version: dict[str, int] = {}
        """By object: the version in which it was last moved here. The plan shows that, although its map may still be an earlier one."""

    async def moved(self, event: dict[str, Any]) -> None:
        """Handle an object that was moved or turned."""
        move = Move(name=str(event["name"]), x=event["x"], y=event["y"], turned=event["turned"], target=event["target"])
        await self._carry_out(move.name, event["version"], lambda map: move_changes(map, self._api.context.ontology, move))

    async def shaped(self, event: dict[str, Any]) -> None:
        """Handle a zone of which corners were moved."""
        name, corners = str(event["name"]), [(float(x), float(y)) for x, y in event["corners"]]
        await self._carry_out(name, event["version"], lambda map: shape_changes(map, name, corners))

    def undone(self, version: int, undo_version: int) -> None:
        """Take note that a version was undone here: whoever moves its object next knows of that."""
        self._last_version |= {name: undo_version for name, last in self._last_version.items() if last == version}

    async def _carry_out(self, name: str, version_of_plan: int, find_changes: Callable[[Map], tuple[Change, ...]]) -> None:
        """Change the map as an object was moved on the plan, then confirm or reject the move."""
        version_before = max(version_of_plan, self._last_version.get(name, 0))
        await self._api.context.wait_for_version(version_before)
        map = self._api.context.map
        if name not in map.objects:
            self._plan.reject_move(name)
            notify(f"{name} is no longer on the map: another user removed or renamed it.", bad=True)
            return
        version: int | None = None
        try:
            update = UpdateMap(changes=find_changes(map), author=author(), expected_version=version_before)
            version = (await self._api.map.change(update)).version
        except SomrsError as error:
            if names := overtaken_objects(error):
                reason = f"Another user changed {names} while you moved {name}. The other change is kept; move it again if needed."
            else:
                reason = f"{name} was moved back: {refusal_text(error)}"
            notify(reason, bad=True)
        else:
            self._last_version[name] = version
            self._record_version(version)
            self._plan.confirm_move(name, version)
        finally:
            if version is None:  # also after a defect: the plan waits for an answer
                self._plan.reject_move(name)
