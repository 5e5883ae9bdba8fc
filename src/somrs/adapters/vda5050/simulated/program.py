"""Simulated vehicles behind an MQTT broker."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Iterable

from somrs.adapters.vda5050.messages.decoding import decode
from somrs.adapters.vda5050.messages.encoding import encode
from somrs.adapters.vda5050.messages.header import RETAINED, Topic, Version
from somrs.adapters.vda5050.messages.orders import InstantActions, Order, Responses, ZoneSet
from somrs.adapters.vda5050.messages.states import Connection as ConnectionMessage
from somrs.adapters.vda5050.messages.states import ConnectionState
from somrs.adapters.vda5050.mqtt import BrokerAddress, Connection, Message
from somrs.adapters.vda5050.simulated.body import Body
from somrs.adapters.vda5050.simulated.exchange import (
    Act,
    Connected,
    Effect,
    Felt,
    Garbled,
    Input,
    Instructed,
    Ordered,
    Publish,
    Responded,
    Zoned,
)
from somrs.adapters.vda5050.simulated.vehicle import SimulatedVehicle
from somrs.adapters.vda5050.topics import HeaderWriter, VehicleAddress, read_topic
from somrs.errors import InputError

log = logging.getLogger(__name__)

PERIOD = 0.1
"""Seconds between two looks at the body."""

TO_VEHICLES = (Topic.ORDER, Topic.INSTANT_ACTIONS, Topic.ZONE_SET, Topic.RESPONSES)


class MqttVehicle:
    """A simulated vehicle with a connection of its own, whose last will the broker sends when it is cut off."""

    def __init__(self, address: VehicleAddress, vehicle: SimulatedVehicle, body: Body, broker: BrokerAddress) -> None:
        self.address, self.vehicle, self.body, self._broker = address, vehicle, body, broker
        self.headers = HeaderWriter(address)
        self.connection = self._new_connection()

    async def run(self) -> None:
        """Be there, until cancelled: then the vehicle takes its leave (3.0, 6.5)."""
        running = asyncio.create_task(self.connection.run())
        try:
            while True:
                await asyncio.sleep(PERIOD)
                (self.connection.restore if self.body.is_reachable else self.connection.cut)()
                self.give(Felt(sensed=self.body.sense(time.monotonic())))
        except asyncio.CancelledError:
            self._publish(Topic.CONNECTION, ConnectionMessage(connection_state=ConnectionState.OFFLINE))
            await asyncio.sleep(PERIOD)
            raise
        finally:
            running.cancel()
            await asyncio.wait({running})

    def give(self, input: Input) -> None:
        """Hand something to the state machine, and do what follows."""
        for effect in self.vehicle.handle(input, time.time()):
            self._do(effect)

    def _do(self, effect: Effect) -> None:
        match effect:
            case Act(number=number, command=command):
                self.body.begin(number, command)
            case Publish(topic=topic, message=message):
                self._publish(topic, message)

    def _publish(self, topic: Topic, message: object) -> None:
        self.connection.publish(self._message(topic, message))

    def _message(self, topic: Topic, message: object) -> Message:
        version = self.vehicle.version
        payload = encode(message, self.headers.header(topic, version, time.time()), version)  # type: ignore[arg-type]
        quality = 1 if topic is Topic.CONNECTION else 0
        return Message(topic=self.address.topic(topic), payload=payload, quality=quality, is_retained=topic in RETAINED)

    def _new_connection(self) -> Connection:
        broken = ConnectionMessage(connection_state=ConnectionState.CONNECTION_BROKEN)
        topics = [(self.address.topic(topic), 0) for topic in TO_VEHICLES]
        return Connection(self._broker, topics, self._receive, self._notice_broker, last_will=self._message(Topic.CONNECTION, broken))

    def _notice_broker(self, is_connected: bool) -> None:
        if is_connected:
            self.give(Connected())

    def _receive(self, text: str, payload: bytes) -> None:
        addressed = read_topic(text)
        assert addressed is not None, "only topics of the vehicle are subscribed to"
        topic = addressed[1]
        try:
            received = decode(topic, payload, self.vehicle.version)
        except InputError as error:
            self.give(Garbled(topic=topic, reason=str(error)))
            return
        match received.message:
            case Order() as order:
                self.give(Ordered(order=order, deviations=received.deviations))
            case InstantActions() as actions:
                self.give(Instructed(actions=actions, deviations=received.deviations))
            case ZoneSet(zone_set=content):
                self.give(Zoned(content=content))
            case Responses() as responses:
                self.give(Responded(responses=responses))


async def serve(vehicles: Iterable[MqttVehicle]) -> None:
    """Run vehicles until cancelled."""
    async with asyncio.TaskGroup() as group:
        for vehicle in vehicles:
            group.create_task(vehicle.run())


def address_of(name: str, version: Version, manufacturer: str, interface: str | None = None) -> VehicleAddress:
    """The address of a vehicle whose serial number is its name."""
    default = "vda5050" if version.major >= 3 else "uagv"
    return VehicleAddress(interface=interface or default, major=version.major, manufacturer=manufacturer, serial_number=name)
