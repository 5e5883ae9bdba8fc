"""A simulated ARCOS controller, after the Pioneer 3 Operations Manual (chapter 6) and the Pioneer Gripper Manual.

It is written from the manuals alone and shares no code with the driver, so that a misunderstanding does not sit on both sides.
"""

from __future__ import annotations

import math
import random
import struct
from collections.abc import Iterator

from somrs.adapters.arcos.simulated.body import Body, Place
from somrs.adapters.arcos.simulated.gripper import Gripper

SIP_CYCLE = 0.1
WATCHDOG = 2.0
"""Seconds without a command after which the motors stop, as it comes from the factory; the next command lets them go on."""
SONAR_CYCLE = 0.04
STALL_RECOVERY = 0.5
"""Seconds for which the motors rest after a stall (StallCount)."""
TOP_SPEED, TOP_TURN = 2200.0, 300.0
"""TransVelTop and RotVelTop, mm/s and degrees/s."""
SPEED_LIMIT, TURN_LIMIT = 750.0, 100.0
"""TransVelMax and RotVelMax, mm/s and degrees/s."""
ACCELERATION, TURN_ACCELERATION = 300.0, 100.0
"""mm/s² and degrees/s²."""
EMERGENCY = 1500.0
"""Deceleration of E_STOP, mm/s²; turning stops at once."""
HALF_AXLE = 165.0
"""mm"""
EMPTY, FULL = 11.5, 13.0
"""Volts."""

_SONAR = (
    (69, 136, 90), (114, 119, 50), (148, 78, 30), (166, 27, 10), (166, -27, -10), (148, -78, -30), (114, -119, -50), (69, -136, -90),
    (-157, -136, -90), (-203, -119, -130), (-237, -78, -150), (-255, -27, -170),
    (-255, 27, 170), (-237, 78, 150), (-203, 119, 130), (-157, 136, 90),
)  # fmt: skip


def packet(content: bytes) -> bytes:
    """A packet with this content."""
    total = 0
    for index in range(0, len(content) - 1, 2):
        total += (content[index] << 8) + content[index + 1]
    total &= 0xFFFF
    if len(content) % 2:
        total ^= content[-1]
    return b"\xfa\xfb" + bytes((len(content) + 2,)) + content + struct.pack(">H", total)


def packets(buffer: bytearray) -> Iterator[bytes]:
    """Take the contents of complete packets out of a buffer; noise and packets with a wrong checksum are dropped."""
    while True:
        while buffer and not buffer.startswith(b"\xfa\xfb"[: len(buffer)]):
            del buffer[0]
        if len(buffer) < 3 or len(buffer) < 3 + buffer[2]:
            return
        content = bytes(buffer[3 : 1 + buffer[2]])
        if buffer[2] >= 3 and packet(content) == bytes(buffer[: 3 + buffer[2]]):
            del buffer[: 3 + buffer[2]]
            yield content
        else:
            del buffer[0]


class Firmware:
    """A controller on a body. `receive` takes bytes of the client, `step` lets time pass and returns bytes for it.

    `subclass` decides the unit of distance: `p3dx` counts 0.485 mm, `p3dx-sh` 1 mm. `slip`: the standard deviation of the share by which
    wheels slip, drawn anew every step. `gripper`: whether it has one. `watchdog`: its HostWatchDog parameter, s.
    """

    def __init__(
        self,
        body: Body,
        *,
        name: str = "Pioneer",
        subclass: str = "p3dx-sh",
        gripper: bool = True,
        slip: float = 0.0,
        watchdog: float = WATCHDOG,
    ) -> None:
        self.body = body
        self.is_silent = False
        """A fault: it sends nothing."""
        self.stop_button = False
        self.heeds_bumpers = True
        """Whether it does what BUMPSTALL says."""
        self.gripper = Gripper(body) if gripper else None
        self._name, self._subclass = name, subclass
        self._unit = 0.485 if subclass == "p3dx" else 1.0
        self._watchdog = watchdog
        self._slip, self._random = slip, random.Random(0)
        self._buffer = bytearray()
        self._replies = bytearray()
        self._synchronized = 0
        self._is_open = False
        self._motors = False
        self._sonar = True
        self._sonar_due: list[int] = []
        self._next_sonar = 0
        self._bump_stall = 0
        self._goal = (0.0, 0.0)
        self._velocity = (0.0, 0.0)
        self._limits = SPEED_LIMIT, TURN_LIMIT
        self.rates = [ACCELERATION, ACCELERATION, TURN_ACCELERATION, TURN_ACCELERATION]
        """TransAccel, TransDecel, RotAccel and RotDecel, mm/s² and degrees/s²."""
        self._emergency = False
        self._stalled = 0.0
        self._charge_mechanism = self._charged_motors = False
        self._silence = 0.0
        self._until_sip = self._until_sonar = 0.0
        self._place = body.place
        self._counted = (0.0, 0.0, 0.0)

    @property
    def velocity(self) -> tuple[float, float]:
        """With which it drives, mm/s and degrees/s."""
        return self._velocity

    def switch_motors_on(self) -> None:
        """Somebody presses the MOTORS button, if the motors are off."""
        self._motors = not self.stop_button

    # What the client sends

    def receive(self, data: bytes) -> None:
        self._buffer += data
        for content in packets(self._buffer):
            self._take(content)

    def _take(self, content: bytes) -> None:
        if not self._is_open and self._synchronized < 3:
            self._synchronize(content[0])
        else:
            self._silence = 0.0
            self._obey(content[0], _argument(content))

    def _synchronize(self, number: int) -> None:
        """Answer a synchronization packet, if it is the one that is due; begin again otherwise."""
        if number == self._synchronized:
            identity = f"{self._name}\0Pioneer\0{self._subclass}\0".encode() if number == 2 else b""
            self._replies += packet(bytes((number,)) + identity)
            self._synchronized += 1
        else:
            self._synchronized = 0

    def _obey(self, number: int, argument: int) -> None:
        """Carry out a command (Operations Manual, table 6)."""
        match number:
            case 1:  # OPEN
                self._is_open = True
            case 2:  # CLOSE
                self._close()
            case 4:  # ENABLE
                self._motors = bool(argument) and not self.stop_button
                if self._motors:
                    self._move_charging_mechanism(False)
            case 5 | 23 if argument:  # SETA, SETRA
                self.rates[(0 if number == 5 else 2) + (argument < 0)] = float(abs(argument))
            case 6:  # SETV
                self._limits = min(float(abs(argument)), TOP_SPEED), self._limits[1]
            case 10:  # SETRV
                self._limits = self._limits[0], min(float(abs(argument)), TOP_TURN)
            case 7:  # SETO
                self._counted = (0.0, 0.0, 0.0)
            case 11:  # VEL
                self._goal, self._emergency = (_limited(argument, self._limits[0]), self._goal[1]), False
            case 9 | 21:  # ROTATE, RVEL
                self._goal, self._emergency = (self._goal[0], _limited(argument, self._limits[1])), False
            case 18:  # CONFIG
                self._replies += packet(self._configuration())
            case 28:  # SONAR
                self._sonar = bool(argument)
            case 29:  # STOP
                self._goal = (0.0, 0.0)
            case 44:  # BUMPSTALL
                self._bump_stall = argument
            case 55:  # E_STOP
                self._goal, self._emergency = (0.0, 0.0), True
            case 68:  # CHARGE
                self._move_charging_mechanism(bool(argument))
            case 33 if self.gripper is not None:  # GRIPPER
                self.gripper.command(argument)
            case 37 if argument:  # GRIPREQUEST
                self._replies += packet(bytes((0xE0, self.gripper is not None, self.gripper.state if self.gripper else 0, 10)))

    def _move_charging_mechanism(self, is_deployed: bool) -> None:
        """Motors are off while it is deployed, and then as they were before ("Pioneer 3 Operations Manual", automated recharging)."""
        if is_deployed and not self._charge_mechanism:
            self._charged_motors, self._motors = self._motors, False
        elif self._charge_mechanism and not is_deployed:
            self._motors = self._motors or self._charged_motors
        self._charge_mechanism = is_deployed
        self.body.set_charging(is_deployed)

    def _close(self) -> None:
        self._is_open, self._synchronized, self._motors, self._goal = False, 0, False, (0.0, 0.0)

    def _configuration(self) -> bytes:
        texts = b"Pioneer\0" + self._subclass.encode() + b"\0SIM001\0"
        tops = struct.pack("<BHHHHH", 0, 300, 2200, 300, 2000, 500)
        watchdog = round(1000 * self._watchdog)
        equipment = struct.pack("<BBBHHBHHH", 100, 0, 0, self.gripper is not None, 1, 1, 115, 16570, watchdog)
        return b"\x20" + texts + tops + self._name.encode() + b"\0" + equipment

    # Time

    def step(self, duration: float) -> bytes:
        """So many seconds pass, a few hundredths. Returns what the controller sends meanwhile."""
        if self.stop_button:
            self._motors = False
        self._silence += duration
        self._move(duration)
        if self.gripper is not None:
            self.gripper.advance(duration)
        self._until_sonar -= duration
        if self._sonar and self._until_sonar <= 0:
            self._until_sonar += SONAR_CYCLE
            self._sonar_due += [self._next_sonar, self._next_sonar + 8]
            self._next_sonar = (self._next_sonar + 1) % 8
        self._until_sip -= duration
        if self._until_sip <= 0:
            self._until_sip += SIP_CYCLE
            if self._is_open:
                self._replies += packet(self._sip())
            self._sonar_due = []
        replies, self._replies = bytes(self._replies), bytearray()
        return b"" if self.is_silent else replies

    def _move(self, duration: float) -> None:
        may_drive = self._motors and self._silence < self._watchdog and self._stalled <= 0
        if (
            self.heeds_bumpers
            and self.body.contact is not None
            and self._bump_stall & {"front": 1, "rear": 2}[self.body.contact]
            and self._pushes()
        ):
            self._stalled = STALL_RECOVERY
        self._stalled = max(0.0, self._stalled - duration)
        goal = self._goal if may_drive else (0.0, 0.0)
        is_stopping = self._emergency or not self._motors
        speed, turn = self._velocity
        rate = EMERGENCY if is_stopping else self.rates[_is_braking(speed, goal[0])]
        turn_rate = 10 * TURN_ACCELERATION if is_stopping else self.rates[2 + _is_braking(turn, goal[1])]
        self._velocity = _ramp(speed, goal[0], rate * duration), _ramp(turn, goal[1], turn_rate * duration)
        self.body.drive(self._velocity[0] / 1000, math.radians(self._velocity[1]))
        self.body.advance(duration)
        if self.body.is_blocked and self._velocity != (0.0, 0.0):
            self._stalled = STALL_RECOVERY
            self._velocity = (0.0, 0.0)
        self._count(self.body.place)

    def _pushes(self) -> bool:
        """Whether it drives towards what a bumper touches."""
        return self._velocity[0] * (1 if self.body.contact == "front" else -1) > 0

    def _count(self, place: Place) -> None:
        """Integrate what the encoders count, in mm and radians, with the slip of the wheels."""
        x, y, heading = self._counted
        turned = math.remainder(place.yaw - self._place.yaw, 2 * math.pi)
        dx, dy = place.x - self._place.x, place.y - self._place.y
        middle = self._place.yaw + turned / 2
        travel = 1000 * (dx * math.cos(middle) + dy * math.sin(middle)) * self._random.gauss(1.0, self._slip)
        turned *= self._random.gauss(1.0, self._slip)
        direction = heading + turned / 2
        self._counted = x + travel * math.cos(direction), y + travel * math.sin(direction), heading + turned
        self._place = place

    # What it reports

    def _sip(self) -> bytes:
        speed, turning = self._velocity
        wheel = math.radians(turning) * HALF_AXLE
        is_moving = abs(speed) > 1 or abs(turning) > 0.5
        volts = round(10 * (EMPTY + (FULL - EMPTY) * self.body.charge))
        flags = self._motors | (0b11110 if self._sonar else 0) | self.stop_button << 5 | self._has_power() << 10
        head = struct.pack(
            "<BHHhhhBHhHB",
            0x33 if is_moving else 0x32,
            round(self._counted[0] / self._unit) & 0xFFFF,
            round(self._counted[1] / self._unit) & 0xFFFF,
            (round(self._counted[2] * 4096 / (2 * math.pi)) + 2048) % 4096 - 2048,
            round(speed - wheel),
            round(speed + wheel),
            min(volts, 255),
            self._stall_bits(),
            0,
            flags,
            0,
        )
        ranges = b"".join(struct.pack("<BH", number, self._range(number)) for number in self._sonar_due)
        state, inputs = (self.gripper.state, self.gripper.inputs) if self.gripper is not None else (0, 0)
        charge_state = (3 if self.body.charge >= 1.0 else 1) if self._has_power() else 0
        tail = struct.pack("<BBBBBHBh", state, 0, 0, inputs, 0, volts, charge_state, round(10 * turning))
        return head + bytes((len(self._sonar_due),)) + ranges + tail

    def _has_power(self) -> bool:
        return self._charge_mechanism and self.body.has_charger

    def _stall_bits(self) -> int:
        wheels = 0x0101 if self._stalled > 0 else 0
        return wheels | {"front": 0b11111 << 9, "rear": 0b11111 << 1}.get(self.body.contact or "", 0)

    def _range(self, number: int) -> int:
        x, y, degrees = _SONAR[number]
        distance = self.body.echo(x / 1000, y / 1000, math.radians(degrees))
        return min(5000, round(1000 * distance)) if math.isfinite(distance) else 5000


def _argument(content: bytes) -> int:
    if len(content) < 4 or content[1] == 0x2B:
        return 0
    size = content[2] | content[3] << 8
    return -size if content[1] == 0x1B else size


def _is_braking(velocity: float, goal: float) -> bool:
    return velocity * (goal - velocity) < 0


def _limited(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))


def _ramp(value: float, goal: float, step: float) -> float:
    return goal if abs(goal - value) <= step else value + math.copysign(step, goal - value)
