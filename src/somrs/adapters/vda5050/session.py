"""The messages of one vehicle: they are read and written here, and handled by its state machine."""

from __future__ import annotations

import contextlib
import logging
import re
import time
import uuid
from collections.abc import Callable, Iterator

from somrs.adapters.vda5050.control.exchange import (
    Arrived,
    Broken,
    Disconnected,
    Effect,
    GaveUp,
    Input,
    Refused,
    Send,
    Subscribed,
    Tolerated,
    Warned,
)
from somrs.adapters.vda5050.control.novelty import Novelty
from somrs.adapters.vda5050.control.policy import Policy
from somrs.adapters.vda5050.control.vehicle import VehicleControl
from somrs.adapters.vda5050.frames import Frames
from somrs.adapters.vda5050.messages.decoding import decode
from somrs.adapters.vda5050.messages.encoding import encode
from somrs.adapters.vda5050.messages.header import Topic, Version
from somrs.adapters.vda5050.topics import HeaderWriter, VehicleAddress
from somrs.errors import InputError

log = logging.getLogger(__name__)

NUMBERS = re.compile(r"\d+")
"""What differs between two messages that cannot be read for the same reason."""


LINE = 400
"""How many characters of what a vehicle says are in the log."""


def brief(words: str) -> str:
    """What a vehicle says, as a line of the log."""
    text = " ".join(words.split())
    return text if len(text) <= LINE else f"{text[:LINE]}..."


def _ignore(effect: Effect) -> None:
    """Do nothing: there is no device yet."""


class VehicleSession:
    """`send`: publishes a message at a topic. `on_effect`: gets what the state machine has found; set by the device. `policy`: what
    the site wants of the vehicle."""

    def __init__(self, address: VehicleAddress, frames: Frames, send: Callable[[str, bytes], None], policy: Policy | None = None) -> None:
        self.address = address
        self.control = VehicleControl(frames, Version.closest("", address.major), lambda: uuid.uuid4().hex, policy)
        self.on_effect: Callable[[Effect], None] = _ignore
        self._send = send
        self._headers = HeaderWriter(address)
        self._complaints = Novelty()

    def receive(self, topic: Topic, payload: bytes) -> None:
        """Take in a message of the vehicle. One that cannot be read is told once, and is as good as lost."""
        try:
            received = decode(topic, payload, self.control.vehicle.version)
        except InputError as error:
            if self._complaints.is_new(NUMBERS.sub("#", str(error))):
                log.warning("%s: a message cannot be read: %s", self.address, brief(str(error)))
            return
        self.give(Arrived(topic=topic, received=received))

    def notice_broker(self, *, is_connected: bool) -> None:
        """Whether the broker is there; without it, the vehicle cannot be reached."""
        self.give(Subscribed() if is_connected else Disconnected())

    def give(self, input: Input) -> None:
        """Hand something to the state machine, and do what follows."""
        now = time.time()
        with self._others_go_on(input):
            for effect in self.control.handle(input, now):
                with self._others_go_on(effect):
                    self._do(effect, now)
                    self.on_effect(effect)

    @contextlib.contextmanager
    def _others_go_on(self, cause: Input | Effect) -> Iterator[None]:
        """A defect in what has to do with one vehicle is no reason to leave all others alone."""
        try:
            yield
        except Exception:
            log.exception("%s: %s had no effect", self.address, type(cause).__name__)

    def _do(self, effect: Effect, now: float) -> None:
        match effect:
            case Send(topic=topic, message=message):
                version = self.control.vehicle.version
                payload = encode(message, self._headers.header(topic, version, now), version)
                self._send(self.address.topic(topic), payload)
            case Tolerated(deviation=deviation):
                log.warning("%s: is not as VDA 5050 has it: %s", self.address, brief(deviation))
            case Refused(description=description) | Warned(description=description):
                log.warning("%s: %s", self.address, brief(description))
            case GaveUp(description=description):
                log.warning("%s: does not drive on: %s", self.address, brief(description))
            case Broken(reason=str(reason)):
                log.warning("%s: cannot drive: %s", self.address, brief(reason))
