"""What a robot of any make holds, as far as it is known. It is in a file, too: the robot's program may die while the robot picks, carries
or drops something."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path

import msgspec
from msgspec import Struct

from somrs.atomic_files import write_atomically
from somrs.devices.road.hardware import Vehicle
from somrs.devices.simulator.link.commands import ObjectState

log = logging.getLogger(__name__)

THIS_SPOT = ""
"""The `target` of a thing that is put down where the robot stands."""


class Held(Struct, frozen=True, kw_only=True):
    """A thing that a robot picked. `origin`: from what it was taken; None: not known. `target`: on what it is being put; None: it is not.
    `is_sure`: it is in the gripper; otherwise it is there or on its target, without one on its origin: picking or dropping has not ended,
    as far as anybody knows."""

    thing: str
    origin: str | None = None
    target: str | None = None
    is_sure: bool = True


class Stored(Struct, frozen=True, kw_only=True):
    """What is stored. `place`: where the last thing is with which the robot had to do, if it is not in its gripper: where the map had it
    when the robot was sent to it, or where the robot put it. Who has it carried may not know: the map forgets what may have changed."""

    held: Held | None = None
    place: ObjectState | None = None


class Gripper:
    """The gripper of one robot. It has the robot's `holding` say what is known."""

    def __init__(self, robot: Vehicle) -> None:
        self._robot = robot
        self._stored = Stored()
        self.is_working = False
        """Whether something is being picked or dropped, also by a robot that cannot be reached: until it ends, what the robot says is of a
        moment in between."""

    @property
    def held(self) -> Held | None:
        return self._stored.held

    @property
    def place(self) -> ObjectState | None:
        return self._stored.place

    @property
    def _file(self) -> Path:
        return self._robot.data / "grippers" / f"{self._robot.name}.json"

    @property
    def has_dropped(self) -> bool:
        """Whether the thing is on its target, and nobody has said so yet."""
        return self.held is not None and self.held.target is not None and not self.held.is_sure and self._robot.carries is False

    @property
    def is_unsure(self) -> bool:
        """Whether the thing may be in the gripper or not, and the robot cannot say."""
        return self.held is not None and not self.held.is_sure and self._robot.carries is None

    def load(self, held_on_map: Sequence[str]) -> None:
        """Read what an earlier program of the robot knew. `held_on_map`: what the map has in the gripper, in case nothing was stored."""
        self._stored = Stored(held=Held(thing=held_on_map[0]) if held_on_map else None)
        try:
            self._stored = msgspec.json.decode(self._file.read_bytes(), type=Stored)
        except FileNotFoundError:
            pass
        except (OSError, msgspec.DecodeError) as error:
            log.warning("%s cannot be read, so that what the map says of the gripper is believed: %s", self._file, error)
        self.is_working = self.held is not None and not self.held.is_sure
        self.settle()

    def settle(self) -> None:
        """Take in what the robot says, while it picks and drops nothing."""
        held, carries = self.held, self._robot.carries
        if held is None or self.is_working:
            return
        if carries and not held.is_sure:
            self.hold(held.thing, held.origin)
        elif carries is False and (held.is_sure or held.target is None):
            if held.is_sure:
                log.warning("%s does not hold %s any more", self._robot.name, held.thing)
            self.release(self.place if not held.is_sure else None)
        else:
            self._robot.holding = held.thing

    def begin_pick(self, thing: str, origin: str | None) -> None:
        self._begin(Held(thing=thing, origin=origin, is_sure=False), self.place)

    def begin_drop(self, thing: str, target: str) -> None:
        origin = self.held.origin if self.held is not None and self.held.thing == thing else None
        self._begin(Held(thing=thing, origin=origin, target=target, is_sure=False))

    def _begin(self, held: Held, place: ObjectState | None = None) -> None:
        self.is_working = True
        self._store(Stored(held=held, place=place))

    def end(self, *, is_lost: bool = False) -> None:
        """What was begun has ended without success, and the robot says what it holds. `is_lost`: the thing may be elsewhere now."""
        held, carries = self.held, self._robot.carries
        if not self.is_working:
            return
        if held is not None and (carries or (carries is None and self._robot.holding == held.thing)):
            self.hold(held.thing, held.origin)
        elif held is not None and held.target is not None and carries is False and not is_lost:
            self.leave()  # it was let go of at the target, before that ended
        else:
            self.release(self.place if not is_lost else None)

    def leave(self) -> None:
        """What was begun has ended, and nobody knows how, unless the robot says what it holds."""
        self.is_working = False
        self.settle()

    def hold(self, thing: str, origin: str | None) -> None:
        """The thing is in the gripper."""
        self._robot.holding, self.is_working = thing, False
        self._store(Stored(held=Held(thing=thing, origin=origin)))

    def release(self, place: ObjectState | None = None) -> None:
        """Nothing is in the gripper. `place`: where the thing is with which the robot had to do; None: not known."""
        self._robot.holding, self.is_working = None, False
        self._store(Stored(place=place))

    def note(self, place: ObjectState) -> None:
        """The robot is sent to a thing, which is there."""
        if self.held is None:
            self._store(Stored(place=place))

    def _store(self, stored: Stored) -> None:
        if stored == self._stored:
            return
        self._stored = stored
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(self._file, msgspec.json.encode(stored))
        except OSError as error:
            log.warning("%s cannot be written: %s", self._file, error)
