"""The order in which messages were sent, by their headers: MQTT may repeat them, and brokers may change their order."""

from __future__ import annotations

from collections import deque

from somrs.adapters.vda5050.messages.header import Header, Topic, seconds_of

SEVERAL = "shares its manufacturer and serial number with another vehicle, or starts anew all the time"

RESTARTS, RESTARTS_SPAN = 3, 60.0
"""How often the numbers of a vehicle's messages go back, within how many seconds, until it is taken for two."""

WINDOW = 1000
"""Header ids that are lower by as much are late; those of a vehicle that has restarted are lower by more, or have a later timestamp."""


class HeaderLog:
    """The last header of each topic. `lost`: how many messages of all topics never came; each state is whole, so that nothing is done
    about it."""

    def __init__(self) -> None:
        self._headers: dict[Topic, Header] = {}
        self.lost = 0
        self._restarts: deque[float] = deque(maxlen=RESTARTS)
        self._begun: set[Topic] = set()
        """The topics whose next message is the first since the vehicle has connected."""
        self.doubt: str | None = None
        """Why it is not clear which vehicle speaks; None: it is."""

    def connect(self, header: Header) -> None:
        """The vehicle has connected, perhaps after a restart: its numbers, and its clock, may begin anew."""
        previous = self._headers.get(Topic.CONNECTION)
        if previous != header:
            self._begun = {*self._headers} - {Topic.CONNECTION}

    def is_old(self, topic: Topic, header: Header, now: float) -> bool:
        """Whether a message was sent before one that has already come, or has come itself. Notes the header if not.

        A connection message never is: the broker sends a last will with the header that it had when the vehicle connected (3.0, 6.5).
        """
        previous, is_first = self._headers.get(topic), topic in self._begun
        self._begun.discard(topic)
        if topic is not Topic.CONNECTION and previous is not None and header.timestamp:
            lag = (previous.header_id - header.header_id) % 2**32
            moment, previous_moment = seconds_of(header.timestamp) or 0.0, seconds_of(previous.timestamp) or 0.0
            is_late = 0 < lag < WINDOW and moment <= previous_moment and not is_first
            if (lag == 0 and header.timestamp == previous.timestamp) or is_late:
                return True
            if 0 < lag < 2**31 and topic is Topic.STATE:
                self._restarts.append(now)
            gap = (header.header_id - previous.header_id) % 2**32
            self.lost += gap - 1 if 1 < gap < WINDOW else 0
        self._headers[topic] = header
        is_doubled = len(self._restarts) == RESTARTS and now < self._restarts[0] + RESTARTS_SPAN
        self.doubt = f"{SEVERAL}: the numbers of its messages go back again and again" if is_doubled else None
        return False
