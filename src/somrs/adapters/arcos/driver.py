"""The driver of a Pioneer robot as a pure state machine: `handle(input, now)` returns effects.

Everything that makes the robot move is an answer to one of its reports. When reports stop, so do commands, and the robot's own watchdog
stops it.
"""

from __future__ import annotations

import math

from msgspec.structs import replace
from pydantic import Field

from somrs.adapters.arcos.actions import RunningAction, begin, is_standing
from somrs.adapters.arcos.course import Course
from somrs.adapters.arcos.events import (
    Action,
    ActionDone,
    ActionFailed,
    BatteryLevel,
    Broken,
    Connected,
    Disconnected,
    Effect,
    Follow,
    GaveUp,
    Halt,
    Halted,
    Heard,
    Holds,
    Input,
    LineIsPoor,
    Located,
    MoveGripper,
    Passed,
    Quit,
    Received,
    Tick,
    Transmit,
)
from somrs.adapters.arcos.gripper import holds
from somrs.adapters.arcos.messages import Command, Flag, GripperCommand, Status
from somrs.adapters.arcos.motors import WHY_OFF, Motors, MotorsOff
from somrs.adapters.arcos.obedience import Obedience
from somrs.adapters.arcos.obstacles import SonarMap
from somrs.adapters.arcos.odometry import Odometry, Pose, Reckoning
from somrs.adapters.arcos.own_parameters import limits, own_parameters
from somrs.adapters.arcos.parameters import Parameters
from somrs.adapters.arcos.session import Session, SessionState
from somrs.adapters.arcos.stalls import Diagnosis, DrawingBack, is_towards, touched
from somrs.adapters.arcos.steering import STAND, Speeds
from somrs.ontology.files.documents import Entry

STOPPED_AFTER = 4.0
"""Seconds after the last report in which its watchdog has stopped a robot: two, and the time in which it brakes."""
PATIENCE = 10.0
"""Seconds for which a robot waits for something in its way."""
STUCK_REPORTS = 30
"""A robot that does not move in so many reports, although it was told to, gives up."""
LIMITS_TOLD = 3
"""How often a robot is told its limits: it does not say whether it has heard them."""
BATTERY_SHARE = 0.05
"""Share of a new report in the voltage, which falls while the motors pull."""


class Battery(Entry):
    """The voltages of an empty and of a full battery, V."""

    empty: float = Field(default=11.5, gt=0, le=60, json_schema_extra={"unit": "V"})
    full: float = Field(default=13.0, gt=0, le=60, json_schema_extra={"unit": "V"})


class Driver:
    """Drives one robot. `pose`: where it is at the beginning. `parameters`: None: those of the type that the robot says it is. `speed`:
    with which it drives at most, m/s; None: as in the parameters. `earlier`: where an earlier program has left it, which holds if the
    robot is still in the same session. `motors_off`: why its motors are to stay off, as an earlier program knew."""

    def __init__(
        self,
        pose: Pose,
        parameters: Parameters | None = None,
        battery: Battery | None = None,
        speed: float | None = None,
        earlier: Reckoning | None = None,
        motors_off: MotorsOff | None = None,
    ) -> None:
        self.session = Session(Motors(motors_off))
        self.parameters = parameters
        self._given_parameters = parameters
        self._battery = battery or Battery()
        self._speed_limit = speed
        self._odometry = Odometry(pose)
        self._earlier = earlier
        self._sonar = SonarMap()
        self._course = Course()
        self._action: RunningAction | None = None
        self._is_halting = False
        self._speeds = STAND
        self._waits_since: float | None = None
        self._stuck_reports = 0
        self._was_stalled = False
        self._drawing_back: DrawingBack | None = None
        self._is_held = False
        """Whether a bumper has gone on to touch something after the robot has drawn back."""
        self._broken: str | None = None
        self._felt = False
        self._holds: bool | None = None
        self._voltage: float | None = None
        self._charge: int | None = None
        self._obedience = Obedience()
        self._failed_way: str | None = None
        """Why the robot has left its way, until it can be reached again."""
        self._is_connected = False
        self._problem: str | None = None
        """Why it cannot be reached, as it was told."""
        self._is_line_poor = False
        self._untold_limits = 0
        """How often the robot is still to be told its limits."""
        self._report_time = -STOPPED_AFTER
        self._report: Status | None = None
        self._effects: list[Effect] = []

    @property
    def pose(self) -> Pose:
        return self._odometry.pose

    @property
    def reckoning(self) -> Reckoning | None:
        """The pose, and what was counted there; None before the first report."""
        return self._odometry.reckoning

    @property
    def motors_off(self) -> MotorsOff | None:
        """Why its motors are to stay off until a person switches them on; None: they are not."""
        return self.session.motors.off_reason

    @property
    def has_gripper(self) -> bool:
        return self.session.gripper is not None and self.session.gripper.kind != 0

    def handle(self, input: Input, now: float) -> list[Effect]:
        """Take in an input, at a time in seconds, and return its effects."""
        match input:
            case Connected():
                self.session.connect(now)
            case Disconnected(problem):
                self.session.disconnect(problem)
            case Received(data):
                for status in self.session.receive(data, now):
                    self._update(status, now)
            case Tick():
                self.session.tick(now)
                if self._is_halting and now - self._report_time >= STOPPED_AFTER:
                    self._note_halt()
            case Follow(way):
                self._course.follow(way)
                self._waits_since, self._stuck_reports = None, 0
            case Halt():
                self._end("it was told to stop")
                self._is_halting = True
                self.session.send(Command.STOP)
            case Quit():
                self.session.close()
            case _:
                self._act(input)
        self._note_contact()
        if self.session.outgoing and self.session.state is not SessionState.DISCONNECTED:
            self._effects.append(Transmit(bytes(self.session.outgoing)))
        self.session.outgoing.clear()
        effects, self._effects = self._effects, []
        return effects

    def _act(self, action: Action) -> None:
        # A robot that is stuck can still put down what it holds. What a person has stopped does nothing.
        is_stopped = self._broken is not None and not (self._broken == WHY_OFF[MotorsOff.STUCK] and isinstance(action, MoveGripper))
        if is_stopped or self.parameters is None:
            self._effects.append(ActionFailed(description=self._broken or "it has not said yet what it is"))
            return
        self._course.clear()
        self._stuck_reports, self._drawing_back = 0, None
        self._action = begin(action, self.parameters)

    def _note_contact(self) -> None:
        problem = self.session.problem
        if self._is_connected == (self.session.is_known and self.parameters is not None) and problem == self._problem:
            return
        was_connected, self._problem = self._is_connected, problem
        self._is_connected = self.session.is_known and self.parameters is not None
        if self._is_connected != was_connected:
            self._untold_limits = LIMITS_TOLD
            if self._is_connected and self._report is not None:
                self._note_grip(self._report)
        elif self._is_connected or problem is None:
            return
        self._effects.append(Heard(self._is_connected, problem if not self._is_connected else None))
        if self._is_connected and self._failed_way is not None:
            self._effects.append(GaveUp(self._failed_way))
            self._failed_way = None

    def _update(self, status: Status, now: float) -> None:
        """Take in a report, and say what the robot is to do until the next one."""
        parameters = self._own_parameters()
        if parameters is None:
            return
        if self._earlier is not None and self.session.has_gone_on:
            self._odometry.resume(self._earlier)
        self._earlier = None
        self.parameters, self._report_time = parameters, now
        confirmed = self._confirmed(status)
        self._note_grip(status)
        self._note_contact()
        pose = self._odometry.update(status, parameters)
        self._effects.append(Located(pose))
        self._sonar.update(status, pose, parameters, now)
        self._note_battery(status)
        self._note_line()
        self._note_health(confirmed)
        self._note_obedience(status, parameters, now)
        self._tell_limits(parameters)
        speeds = self._next_speeds(confirmed, pose, parameters, now)
        if self._is_halting and is_standing(status):
            self._note_halt()
        self._command(speeds, status)
        self._obedience.tell(self._speeds, now)

    def _note_obedience(self, status: Status, parameters: Parameters, now: float) -> None:
        """A robot that does not do what it is told has left its way, and is not trusted until it has begun another session."""
        problem = self._obedience.update(_motion(status, parameters), parameters, now)
        if problem is None or not self.session.is_open or not status.flags & Flag.MOTORS:
            return
        self._failed_way = problem if not self._course.is_complete else None
        self._end(problem)
        self.session.mistrust(problem)

    def _note_line(self) -> None:
        quality = self.session.quality
        if quality.is_poor != self._is_line_poor:
            self._is_line_poor = quality.is_poor
            self._effects.append(LineIsPoor(quality.share if quality.is_poor else None))

    def _note_grip(self, status: Status) -> None:
        """Say what the paddles hold, if two reports agree on it."""
        felt, self._felt = self._felt, holds(status)
        is_holding = self.has_gripper and self._felt
        if self.session.is_known and felt == self._felt and is_holding != self._holds:
            self._holds = is_holding
            self._effects.append(Holds(is_holding))

    def _confirmed(self, status: Status) -> Status:
        """A report with what the one before has said, too, of stalls, bumpers and buttons: two wrong bits can cancel out in a checksum."""
        earlier, self._report = self._report or status, status
        return replace(status, stall=status.stall & earlier.stall, flags=status.flags & earlier.flags)

    def _note_halt(self) -> None:
        self._is_halting = False
        self._effects.append(Halted())

    def _own_parameters(self) -> Parameters | None:
        return own_parameters(self._given_parameters, self.session.configuration, self.session.identity, self._speed_limit)

    def _tell_limits(self, parameters: Parameters) -> None:
        """Have the robot accelerate and brake as is reckoned with here, whatever it was configured for."""
        if self._untold_limits:
            self._untold_limits -= 1
            for number, argument in limits(parameters):
                self.session.send(number, argument)

    def _command(self, speeds: Speeds, status: Status) -> None:
        """Send velocities with every report, as long as the robot is to move or moves: one that is lost does no harm then. What touches
        its bumpers may be a person: a single report is enough to stop it."""
        is_touching = is_towards(status.bumpers, speeds) or (bool(status.bumpers) and speeds == STAND)
        if is_touching:
            speeds = STAND
        if is_touching and not is_standing(status):
            self.session.send(Command.ESTOP)
        elif speeds != STAND or self._speeds != STAND or not is_standing(status):
            self.session.send(Command.VEL, round(speeds.forward * 1000))
            self.session.send(Command.RVEL, round(math.degrees(speeds.turning)))
        self._speeds = speeds

    def _next_speeds(self, status: Status, pose: Pose, parameters: Parameters, now: float) -> Speeds:
        if self._is_halting or (self._broken is not None and self._action is None):
            return STAND
        if self._drawing_back is not None:
            return self._next_of_drawing_back(self._drawing_back, status)
        if (problem := self._obstruction(status)) is not None:
            if status.stalled_wheels:
                self._drawing_back = DrawingBack(problem, self._speeds, status.bumpers)
            else:
                self._give_up(problem)
            return STAND
        speeds = self._wanted_speeds(status, pose, parameters, now)
        if is_towards(status.bumpers, speeds):
            self._drawing_back = DrawingBack(touched(status.bumpers), speeds, status.bumpers)
            return STAND
        return speeds

    def _wanted_speeds(self, status: Status, pose: Pose, parameters: Parameters, now: float) -> Speeds:
        """The velocities for what the robot works on, or for its way."""
        if self._action is not None:
            return self._next_of_action(self._action, status, pose)
        speeds, numbers = self._course.steer(pose, _motion(status, parameters), self._sonar, parameters, now)
        self._effects += [Passed(number) for number in numbers]
        if self._is_blocked(speeds, status, now):
            self._give_up(f"something is in the way, {100 * (self._course.gap or 0.0):.0f} cm ahead")
            return STAND
        return speeds

    def _next_of_action(self, action: RunningAction, status: Status, pose: Pose) -> Speeds:
        match action.update(status, pose, self.session.send):
            case Speeds() as speeds:
                return speeds
            case (ActionDone() | ActionFailed()) as end:
                self._action = None
                self._effects.append(end)
        return STAND

    def _next_of_drawing_back(self, drawing_back: DrawingBack, status: Status) -> Speeds:
        match drawing_back.update(status):
            case Speeds() as speeds:
                return speeds
            case Diagnosis.STUCK:
                self._drawing_back = None
                self.session.motors.stop()
                self._note_health(status)
            case _:
                self._drawing_back, self._is_held = None, bool(status.bumpers)
                self._give_up(drawing_back.problem)
        return STAND

    def _obstruction(self, status: Status) -> str | None:
        """Why the robot does not go on, if it was told to move."""
        was_stalled, self._was_stalled = self._was_stalled, bool(status.stalled_wheels)
        is_driving = self._speeds != STAND
        if is_driving and self._was_stalled and not was_stalled:
            if status.bumpers:
                return touched(status.bumpers)
            wheels = " and ".join(status.stalled_wheels)
            return f"it pushes against something: its {wheels} motor is stalled"
        self._stuck_reports = self._stuck_reports + 1 if is_driving and is_standing(status) else 0
        return "it does not move, although its motors are on" if self._stuck_reports >= STUCK_REPORTS else None

    def _is_blocked(self, speeds: Speeds, status: Status, now: float) -> bool:
        """Whether something has been in the way for longer than the robot waits."""
        if self._course.gap is None or speeds != STAND or not is_standing(status):
            self._waits_since = None
            return False
        self._waits_since = now if self._waits_since is None else self._waits_since
        return now - self._waits_since >= PATIENCE

    def _give_up(self, description: str) -> None:
        self.session.send(Command.STOP)
        is_following = not self._course.is_complete
        self._end(description)
        if is_following:
            self._effects.append(GaveUp(description))

    def _end(self, description: str) -> None:
        """End what the robot does."""
        self._course.clear()
        self._waits_since, self._stuck_reports, self._drawing_back = None, 0, None
        if self._action is not None:
            self._action = None
            if self.has_gripper:
                self.session.send(Command.GRIPPER, GripperCommand.HALT)
            self._effects.append(ActionFailed(description=description))

    def _note_health(self, status: Status) -> None:
        reason = WHY_OFF[self.motors_off] if self.motors_off is not None else None
        self._is_held = self._is_held and bool(status.bumpers)
        if status.flags & Flag.STOP_BUTTON:
            reason = "its stop button is pressed"
        elif reason is None and self._is_held:
            reason = touched(status.bumpers)
        if reason == self._broken:
            return
        if reason is not None:
            self._end(reason)
        self._broken = reason
        self._effects.append(Broken(reason))

    def _note_battery(self, status: Status) -> None:
        voltage = status.battery / 10
        self._voltage = voltage if self._voltage is None else self._voltage + BATTERY_SHARE * (voltage - self._voltage)
        share = (self._voltage - self._battery.empty) / (self._battery.full - self._battery.empty)
        charge = round(100 * min(max(share, 0.0), 1.0))
        if charge != self._charge:
            self._charge = charge
            self._effects.append(BatteryLevel(charge))


def _motion(status: Status, parameters: Parameters) -> Speeds:
    """The velocities that a report has."""
    left_speed, right_speed = status.left_speed * parameters.speed_metres, status.right_speed * parameters.speed_metres
    return Speeds(forward=(left_speed + right_speed) / 2, turning=(right_speed - left_speed) / parameters.axle)
