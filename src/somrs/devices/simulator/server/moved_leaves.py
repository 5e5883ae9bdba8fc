"""The leaves of doors and containers that are moved without a drive: by people, who say so on the map, and by robots, at their handles."""

from __future__ import annotations

from collections.abc import Callable

from somrs.devices.simulator.motion.leaves import obstacle_in_sweep
from somrs.devices.simulator.motion.robot import Fleet
from somrs.devices.simulator.world.scene import Scene
from somrs.space.leaves import Leaf


class MovedLeaves:
    """`note`: called with each door or container whose leaves have been moved."""

    def __init__(self, scene: Scene, robots: Fleet, note: Callable[[str], None]) -> None:
        self._scene, self._robots, self._note = scene, robots, note
        self._to_shut: dict[str, tuple[Leaf, ...]] = {}
        """The leaves of the doors that somebody is to shut as soon as nothing obstructs them."""
        self._pulled: set[str] = set()
        """The leaves that robots held by their handles in the last period."""

    def forget(self, owner: str) -> None:
        """Nobody is to shut a door or container any more."""
        self._to_shut.pop(owner, None)

    def move(self, owner: str, *, is_open: bool) -> None:
        """Open a door or container, or shut it: whoever shuts it waits until nothing is in its way."""
        doors = self._scene.leaves(owner)
        if not is_open and self._obstructs(doors):
            self._to_shut[owner] = doors
        else:
            self._set(owner, doors, is_open=is_open)

    def advance(self) -> None:
        """Shut what nothing obstructs any more, and note what robots have let go."""
        for owner, doors in [*self._to_shut.items()]:
            if not self._obstructs(doors):
                del self._to_shut[owner]
                self._set(owner, doors, is_open=False)
        pulled = set(self._scene.hands.pulled.values())
        for owner in {leaf.split("/")[0] for leaf in self._pulled - pulled}:
            self._note(owner)
        self._pulled = pulled

    def _set(self, owner: str, doors: tuple[Leaf, ...], *, is_open: bool) -> None:
        for leaf in doors:
            self._scene.set_leaf(leaf, leaf.travel if is_open else 0.0)
        self._note(owner)

    def _obstructs(self, doors: tuple[Leaf, ...]) -> bool:
        """Whether something is where one of the leaves would move."""
        return any(obstacle_in_sweep(self._scene, leaf, self._robots.values()) is not None for leaf in doors)
