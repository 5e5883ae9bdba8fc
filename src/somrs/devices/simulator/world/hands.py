"""What robots' hands hold. Who may hold what, and how a hand gets there, is in `motion/`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable


class Hands(ABC):
    """The hands of all robots. `held`: the thing that each hand holds, by robot; `pulled`: the leaf whose handle it holds.

    `disturb` is called when what is at rest may begin to move.
    """

    def __init__(self, disturb: Callable[[], None]) -> None:
        self.held: dict[str, str] = {}
        self.pulled: dict[str, str] = {}
        self._disturb = disturb

    def holder(self, thing: str) -> str | None:
        return next((robot for robot, held in self.held.items() if held == thing), None)

    def hold(self, robot: str, thing: str) -> None:
        """Join a thing to the robot's hand in its current relative pose. The caller has checked that both fingers touch it."""
        self._take(robot, thing)
        self.held[robot] = thing

    def release(self, robot: str) -> None:
        """Release the thing that the robot holds, if it does."""
        if robot in self.held:
            self._drop(robot)
            del self.held[robot]
        self._disturb()

    def hold_handle(self, robot: str, leaf: str) -> None:
        """Join the robot's hand to a leaf; it can still turn. The caller has checked that both fingers touch a handle."""
        self._take_handle(robot, leaf)
        self.pulled[robot] = leaf
        self._disturb()

    def let_go(self, robot: str) -> None:
        """Release the handle that the robot holds, if it does."""
        if robot in self.pulled:
            self._drop_handle(robot)
            del self.pulled[robot]
            self._disturb()

    def remove(self, name: str) -> None:
        """Part everything that joins an object, which is about to be removed, to a hand; or the hand of a robot to anything."""
        for robot in [robot for robot, thing in self.held.items() if name in (robot, thing)]:
            self.release(robot)
        for robot in [robot for robot, leaf in self.pulled.items() if name in (robot, leaf.split("/")[0])]:
            self.let_go(robot)

    @abstractmethod
    def _take(self, robot: str, thing: str) -> None:
        """Join the thing to the hand."""

    @abstractmethod
    def _drop(self, robot: str) -> None:
        """Part what is held from the hand."""

    @abstractmethod
    def _take_handle(self, robot: str, leaf: str) -> None:
        """Join the leaf to the hand, which can still turn."""

    @abstractmethod
    def _drop_handle(self, robot: str) -> None:
        """Part the leaf from the hand."""
