"""Who may switch the motors of a robot on: its program, once in a session, or only a person at the robot."""

from __future__ import annotations

from enum import StrEnum, auto

from somrs.adapters.arcos.messages import Flag, Status


class MotorsOff(StrEnum):
    """Why the motors stay off until a person switches them on."""

    BY_HAND = auto()
    """A person has switched them off, or has pressed the stop button."""
    STUCK = auto()
    """The drive is broken: they stall in both directions."""


WHY_OFF = {
    MotorsOff.BY_HAND: "its motors were switched off: press its MOTORS button",
    MotorsOff.STUCK: "its motors stall in both directions, and are off: press its MOTORS button when it is mended",
}
"""The same for people."""


class Motors:
    """The motors of one robot. `off_reason`: why they are to stay off, as an earlier program has stored it; None: they are not.

    Neither a reset of the controller nor another program makes them go on: only a report that they are on again, which the program has not
    asked for. Two reports have to agree.
    """

    def __init__(self, off_reason: MotorsOff | None = None) -> None:
        self.off_reason = off_reason
        self._were_on = True
        """Whether they were on in this session: an earlier program has switched them on, if the session is from before."""
        self._were_off = False
        self._is_charging = False
        self._flags: Flag | None = None

    def begin_session(self) -> None:
        """The controller has begun anew: its motors are off."""
        self._were_on, self._flags = False, None
        self._is_charging = False

    def charge(self, is_deployed: bool) -> None:
        """The program has told the robot to deploy the charging mechanism, or to retract it. Its controller switches the motors off
        meanwhile, and whoever switches them on retracts it ("Pioneer 3 Operations Manual", docking and charging)."""
        self._is_charging = is_deployed

    def stop(self) -> None:
        """The drive is broken."""
        self.off_reason, self._were_off = MotorsOff.STUCK, False

    def update(self, status: Status) -> None:
        """Take in a report."""
        flags = Flag(status.flags & (Flag.MOTORS | Flag.STOP_BUTTON))
        is_confirmed, self._flags = flags == self._flags, flags
        if not is_confirmed:
            return
        if flags == Flag.MOTORS:
            self._were_on = True
            if self.off_reason is MotorsOff.BY_HAND or self._were_off:
                self.off_reason = None
            return
        if not flags and (self._is_charging or status.has_charger_power):
            self._were_on = False
            return
        self._were_off = True
        if self.off_reason is None and (self._were_on or flags & Flag.STOP_BUTTON):
            self.off_reason = MotorsOff.BY_HAND

    @property
    def are_to_go_on(self) -> bool:
        """Whether the program is to switch them on."""
        may_go_on = not self._is_charging and not (self._flags or Flag(0)) & Flag.STOP_BUTTON
        return self.off_reason is None and not self._were_on and may_go_on

    @property
    def are_to_go_off(self) -> bool:
        """Whether the program is to switch them off."""
        return self.off_reason is MotorsOff.STUCK and not self._were_off
