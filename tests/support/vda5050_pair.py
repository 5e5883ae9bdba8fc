"""Fleet control and a simulated vehicle, joined in memory, in virtual time. What they send each other is written and read."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterable
from functools import partial
from typing import TypeVar

from msgspec import Struct

from somrs.adapters.vda5050.control.exchange import Arrived, Effect, Follow, Halt, Input, Passed, Send, Tick
from somrs.adapters.vda5050.control.policy import Policy
from somrs.adapters.vda5050.control.vehicle import VehicleControl
from somrs.adapters.vda5050.frames import Frames
from somrs.adapters.vda5050.messages.decoding import decode
from somrs.adapters.vda5050.messages.encoding import encode
from somrs.adapters.vda5050.messages.factsheets import Factsheet
from somrs.adapters.vda5050.messages.header import Header, Topic, Version, timestamp_of
from somrs.adapters.vda5050.messages.orders import InstantActions, Order, Responses, ZoneSet
from somrs.adapters.vda5050.simulated.body import StandInBody
from somrs.adapters.vda5050.simulated.exchange import Act, Connected, Felt, Instructed, Ordered, Publish, Responded, Zoned
from somrs.adapters.vda5050.simulated.exchange import Effect as VehicleEffect
from somrs.adapters.vda5050.simulated.exchange import Input as VehicleInput
from somrs.adapters.vda5050.simulated.factsheet import factsheet
from somrs.adapters.vda5050.simulated.vehicle import SimulatedVehicle
from somrs.devices.road_robot import Way, Waypoint
from tests.support.vda5050_messages import check_schema

STEP = 0.1
"""Seconds between two looks at the body."""

START = 1_790_000_000.0

E = TypeVar("E", bound=Effect)


def way(*names: str, released: int | None = None, first: int = 0, spacing: float = 2.0) -> Way:
    """Waypoints along the x axis: `A` at 0 m, `B` at 2 m. `released`: how many are; all by default."""
    count = len(names) if released is None else released
    return tuple(
        Waypoint(
            number=first + index,
            name=name,
            x=spacing * (ord(name[0]) - ord("A")),
            y=0.0,
            level=0.0,
            released=index < count,
            speed_limit=1.0,
        )
        for index, name in enumerate(names)
    )


class Pair:
    """`fate`: how many times a message that is sent arrives, by its topic; 1 unless it says otherwise. `delay`: after how many seconds each
    does. `clock_lead`: by how many seconds the vehicle's clock is ahead."""

    def __init__(
        self,
        version: Version = Version.V2_1,
        fate: Callable[[Topic], int] = lambda topic: 1,
        *,
        x: float = 0.0,
        sheet: Factsheet | None = None,
        policy: Policy | None = None,
        clock_lead: float = 0.0,
        delay: Callable[[Topic], float] = lambda topic: 0.0,
    ) -> None:
        identifiers = itertools.count(1)
        self.version, self.fate, self.now, self.clock_lead = version, fate, START, clock_lead
        self._delay = delay
        self._post: list[tuple[float, int, Callable[[], None]]] = []
        """Messages that are to arrive: when, a number, and how."""
        self._post_numbers = itertools.count()
        self.body = StandInBody(x)
        self.vehicle = SimulatedVehicle(version, sheet or factsheet(), map_id="hall")
        self.control = VehicleControl(Frames(), version, lambda: f"id-{next(identifiers)}", policy)
        self.effects: list[Effect] = []
        self.commands: list[tuple[Topic, Struct]] = []
        """What fleet control has sent."""
        self.reported: list[Struct] = []
        """What the vehicle has sent."""
        self._header_ids = itertools.count(1)
        self.is_cut = False
        self._tell(Connected())
        self.run(0.5)

    def do(self, input: Input) -> None:
        """Hand an input to fleet control."""
        for effect in self.control.handle(input, self.now):
            self.effects.append(effect)
            if isinstance(effect, Send):
                self.commands.append((effect.topic, effect.message))
                self._send(effect.topic, partial(self._deliver, effect.topic, effect.message))

    def tell(self, input: VehicleInput) -> None:
        """Hand an input to the vehicle."""
        self._tell(input)

    def run(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(round(seconds / STEP)):
            self.now += STEP
            while self._post and self._post[0][0] <= self.now:
                heapq.heappop(self._post)[2]()
            self._tell(Felt(sensed=self.body.sense(self.now)))
            self.do(Tick())

    def run_until(self, kind: type[E], limit: float = 120.0) -> E:
        """Let time pass until fleet control has had an effect of a kind since the last `forget`. Returns it."""
        for _ in range(round(limit / STEP)):
            if (effect := next((effect for effect in self.effects if isinstance(effect, kind)), None)) is not None:
                return effect
            self.run(STEP)
        raise AssertionError(f"no {kind.__name__} in {limit} s, but { ({type(effect).__name__ for effect in self.effects}) }")

    def forget(self) -> None:
        self.effects, self.commands, self.reported = [], [], []

    def follow(self, *names: str, released: int | None = None, first: int = 0) -> None:
        self.do(Follow(way=way(*names, released=released, first=first)))

    def halt(self) -> None:
        self.do(Halt())

    def passed(self) -> list[int]:
        return [effect.number for effect in self.effects if isinstance(effect, Passed)]

    def orders(self) -> list[Order]:
        return [message for _, message in self.commands if isinstance(message, Order)]

    def instant_actions(self) -> list[str]:
        return [message.actions[0].action_type for _, message in self.commands if isinstance(message, InstantActions)]

    def of(self, *kinds: type[Effect]) -> list[Effect]:
        return [effect for effect in self.effects if isinstance(effect, kinds)]

    def _header(self, seconds: float) -> Header:
        return Header(
            header_id=next(self._header_ids),
            timestamp=timestamp_of(seconds),
            version=self.version.value,
            manufacturer="ACME",
            serial_number="1",
        )

    def _deliver(self, topic: Topic, message: Struct) -> None:
        payload = encode(message, self._header(self.now), self.version)
        check_schema(topic, payload, self.version)
        received = decode(topic, payload, self.version)
        match received.message:
            case Order() as order:
                self._tell(Ordered(order=order, deviations=received.deviations))
            case InstantActions() as actions:
                self._tell(Instructed(actions=actions, deviations=received.deviations))
            case ZoneSet(zone_set=content):
                self._tell(Zoned(content=content))
            case Responses() as responses:
                self._tell(Responded(responses=responses))

    def _tell(self, input: VehicleInput) -> None:
        self._carry_out(self.vehicle.handle(input, self.now + self.clock_lead))

    def _carry_out(self, effects: Iterable[VehicleEffect]) -> None:
        for effect in effects:
            match effect:
                case Act(number=number, command=command):
                    self.body.begin(number, command)
                case Publish(topic=topic, message=message):
                    self.reported.append(message)
                    payload = encode(message, self._header(self.now + self.clock_lead), self.version)
                    check_schema(topic, payload, self.version)
                    received = decode(topic, payload, self.version)
                    assert received.deviations == ()
                    self._send(topic, partial(self.do, Arrived(topic=topic, received=received)))

    def _send(self, topic: Topic, arrive: Callable[[], None]) -> None:
        """Have a message arrive as often, and as late, as is its fate."""
        for _ in range(self.fate(topic) if not self.is_cut else 0):
            delay = self._delay(topic)
            if delay > 0.0:
                heapq.heappush(self._post, (self.now + delay, next(self._post_numbers), arrive))
            else:
                arrive()
