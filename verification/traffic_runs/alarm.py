"""The program that follows the map, and tells traffic when it is held."""

from __future__ import annotations

from somrs.kernel.component import DeliveryFailed, Effect, Effects, Input, Notified, Send
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.traffic import HoldTraffic


class Alarm:
    """It is notified of the reason for which traffic is held, or of an empty one, and tells it until it has arrived."""

    def __init__(self, address: str, traffic: str) -> None:
        self._address, self._traffic = address, traffic
        self._hold = HoldTraffic(number=0)
        self._sent = 0

    def handle(self, event: Input, now: float) -> list[Effect]:
        return [*self._effects(event)]

    def _effects(self, event: Input) -> Effects:
        match event:
            case Notified(str() as reason):
                self._hold = HoldTraffic(reason=reason, number=self._hold.number + 1)
                yield self._send()
            case DeliveryFailed(Message(body=HoldTraffic(number=number))) if number == self._hold.number:
                yield self._send()

    def _send(self) -> Send:
        self._sent += 1
        id = message_id(self._address, self._sent)
        return Send(Message(header=Header(sender=self._address, recipient=self._traffic, message_id=id), body=self._hold))
