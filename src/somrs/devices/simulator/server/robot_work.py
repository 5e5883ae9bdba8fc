"""The work of the simulated robots: the routine that carries out each command, from the command to its result.

How a routine moves its robot is in `motion/`. Devices that stand still answer their commands themselves (`world/stationary.py`).
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field

from msgspec import structs

from somrs.devices.simulator.link.commands import Command, CommandDone, CommandGivenUp, Fault, LookAround, LookAt, ObjectState, Stop
from somrs.devices.simulator.motion.arm import withdraw
from somrs.devices.simulator.motion.driving import drive_on
from somrs.devices.simulator.motion.handling import set_down
from somrs.devices.simulator.motion.robot import GivenUp, Robot, Routine
from somrs.devices.simulator.motion.routines import concerned_objects, make_routine
from somrs.devices.simulator.world.recognition import landmarks, sightings
from somrs.devices.simulator.world.scene import Scene
from somrs.devices.simulator.world.stationary import OnEnd
from somrs.protocol.messages.traffic import Mobility


@dataclass(slots=True)
class Work:
    """The work of a robot: a routine, and the command that it carries out (None: the robot acts on its own)."""

    routine: Generator[None, None, object]
    command: Command | None
    on_end: OnEnd | None
    touched: tuple[str, ...] = ()
    observations: dict[str, ObjectState] = field(default_factory=dict)
    """The objects that were seen, for commands that search."""
    failure: GivenUp | None = None
    """Why the command was given up. Set while the robot still draws its arm in, or puts down what it holds."""


class RobotWork:
    """What each robot works on now."""

    def __init__(self, scene: Scene, robots: Mapping[str, Robot]) -> None:
        self._scene, self._robots = scene, robots
        self._work: dict[str, Work] = {}
        self._dropped: dict[str, str] = {}
        """What robots put down because they cannot carry it further, until their command ends."""

    @property
    def busy(self) -> bool:
        """Whether a robot has work that it can do."""
        return any(self._can_work(name) for name in self._work)

    def _can_work(self, robot: str) -> bool:
        return not (self._robots[robot].is_mute or self._robots[robot].paused)

    # Commands

    def begin(self, robot: Robot, command: Command, on_end: OnEnd) -> None:
        """Carry out a command, which ends the one in progress. `on_end` is called once with the result."""
        running = self._work.get(robot.name)
        reflex = running is not None and (running.command is None or running.failure is not None) and Fault.DRIVE in robot.faults
        if not reflex:
            self._end(robot, GivenUp("stopped", f"{robot.name} received another command"))
        if isinstance(command, Stop) and reflex:
            on_end(CommandDone(state=robot.state()))
            return
        observations: dict[str, ObjectState] = {}
        robot.weighed.clear()
        routine, touched = make_routine(command, robot, self._scene, observations), concerned_objects(command, robot)
        if reflex and running is not None:
            self._end_command_only(robot)
            routine = _chain_routines(running.routine, routine)
        robot.activity = type(command).__name__
        self._work[robot.name] = Work(routine, command, on_end, touched, observations)

    def _end_command_only(self, robot: Robot) -> None:
        """Report the end of the running command to its sender, but let the robot finish putting down what it holds."""
        work = self._work.pop(robot.name)
        self._report(robot, work, work.failure or GivenUp("stopped", f"{robot.name} received another command"))

    # Periods

    def advance(self) -> None:
        """Continue all work by one control period."""
        for name in list(self._work):
            if name in self._work and self._can_work(name):
                self._advance(self._robots[name], self._work[name])

    def make_room(self, robot: Robot) -> None:
        """Let an idle robot drive where traffic has granted it places, because others want to pass.

        One that was stopped between two places stays there as long as nobody waits for it.
        """
        if robot.name not in self._work and robot.mobile and robot.battery.charge > 0 and robot.road.has_to_make_room:
            self._work[robot.name] = Work(_chain_routines(withdraw(robot), drive_on(robot)), None, None)

    def mobility(self, robot: Robot) -> Mobility:
        """Whether the robot can make room for others."""
        if Fault.DRIVE in robot.faults or robot.battery.charge <= 0:
            return Mobility.IMMOBILE
        work = self._work.get(robot.name)
        is_driving = work is None or (work.failure is None and (work.command is None or robot.road.is_travelling))
        return Mobility.FREE if is_driving and not robot.paused else Mobility.BUSY

    def object(self, robot: str) -> str | None:
        """The object with which a robot works: what it grips, or on what it puts something; None if its command names none."""
        work = self._work.get(robot)
        command = work.command if work is not None else None
        return next((name for field in ("object", "support", "container") if (name := getattr(command, field, None)) is not None), None)

    def _advance(self, robot: Robot, work: Work) -> None:
        try:
            next(work.routine)
        except StopIteration:
            self._finish(robot, work)
        except GivenUp as failure:
            self._abort(robot, work, failure)

    # Ends

    def _finish(self, robot: Robot, work: Work) -> None:
        if work.failure is None and robot.holding is not None and Fault.DRIVE in robot.faults and not robot.is_outside:
            failure = GivenUp("drive-dead", f"the drive of {robot.name} is dead")
            self._abort(robot, work, failure)
            return
        del self._work[robot.name]
        self._report(robot, work, work.failure)

    def _abort(self, robot: Robot, work: Work, failure: GivenUp) -> None:
        """Clean up before the command ends: draw the arm in, and put down what cannot be carried further."""
        robot.plan = []
        if work.failure is not None:  # the cleaning up failed, too; it is not repeated
            del self._work[robot.name]
            robot.arm_claim = robot.arm_claim if robot.arm_out else None
            self._report(robot, work, work.failure)
            return
        work.failure = failure
        if Fault.DRIVE in robot.faults and (held := _laid_down(robot)) is not None:
            self._dropped[robot.name] = held
            work.routine = set_down(robot)
        else:
            work.routine = withdraw(robot)

    def _end(self, robot: Robot, failure: GivenUp) -> None:
        """End the robot's work at once."""
        work = self._work.pop(robot.name, None)
        robot.plan, robot.activity = [], None
        if work is not None:
            work.routine.close()
            self._report(robot, work, work.failure or failure)

    def _report(self, robot: Robot, work: Work, failure: GivenUp | None) -> None:
        robot.activity = None
        if work.on_end is None:
            return
        solids = self._scene.world.solids
        dropped = self._dropped.pop(robot.name, None)
        touched = dict.fromkeys([*work.touched, *([dropped] if dropped else []), *([robot.holding] if robot.holding else [])])
        observed = [state for name, state in work.observations.items() if name in solids]
        object_states = (
            *landmarks(self._scene, observed),
            *(structs.replace(self._scene.observe(name), weight=robot.weighed.get(name)) for name in touched if name in solids),
        )
        like = work.command.like if isinstance(work.command, LookAt | LookAround) else None
        seen = sightings(self._scene, robot.name, observed, like)
        on_end, work.on_end = work.on_end, None
        if failure is None:
            on_end(CommandDone(state=robot.state(), object_states=object_states, sightings=seen))
        else:
            on_end(
                CommandGivenUp(
                    reason=failure.reason,
                    description=failure.description,
                    state=robot.state(),
                    object_states=object_states,
                    sightings=seen,
                )
            )

    # Faults, and changes of the map

    def fault(self, robot: Robot, fault: Fault) -> None:
        """Do what a robot does when it gets a fault."""
        name = robot.name
        match fault:
            case Fault.DRIVE if name not in self._work and (held := _laid_down(robot)) is not None:
                self._dropped[name] = held
                self._work[name] = Work(set_down(robot), None, None, failure=GivenUp("drive-dead", f"the drive of {name} is dead"))
            case Fault.SILENT:
                work = self._work.pop(name, None)
                if work is not None:
                    work.routine.close()
                robot.plan, robot.activity = [], None
            case Fault.LINK:
                self._end(robot, GivenUp("stopped", f"the link to {name} is lost"))
            case Fault.GRIPPER if robot.size.gripper:
                robot.hold_joint("left")
                robot.hold_joint("right")

    def interrupt(self, robot: Robot, reason: str) -> None:
        """Give up what the robot does, at once."""
        self._end(robot, GivenUp("stopped", reason))

    def object_removed(self, name: str) -> None:
        """Give up the work that concerns an object, and that of a robot which is removed itself."""
        for robot, work in [*self._work.items()]:
            if robot != name and work.failure is None and (name in work.touched or self._scene.hands.held.get(robot) == name):
                self._abort(self._robots[robot], work, GivenUp("not-possible", f"{name} was removed from the world"))
        if name in self._robots:
            self._end(self._robots[name], GivenUp("stopped", f"{name} was removed from the world"))

    def object_renamed(self, name: str, new_name: str) -> None:
        """Give up the work that concerns an object by its old name."""
        for robot, work in [*self._work.items()]:
            if name in work.touched:
                self._abort(self._robots[robot], work, GivenUp("not-possible", f"{name} was renamed to {new_name}"))


def _laid_down(robot: Robot) -> str | None:
    """What a robot whose drive is dead lays down by itself: what it holds. One that is driven from outside is told to."""
    return robot.holding if Fault.GRIPPER not in robot.faults and not robot.is_outside else None


def _chain_routines(first: Generator[None, None, object], second: Generator[None, None, object]) -> Routine:
    """Run two routines in sequence; the second runs even if the first is given up."""
    with suppress(GivenUp):
        yield from first
    yield from second
