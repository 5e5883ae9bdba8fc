"""What a server takes from others at most, and how long it waits for it. Each limit has a default and an environment variable."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Annotated

import msgspec

from somrs.errors import UsageError

PREFIX = "SOMRS_LIMIT_"
"""The beginning of the names of the variables; the name of the limit in capital letters follows."""

Count = Annotated[int, msgspec.Meta(ge=1, le=2**40)]
"""A positive number that fits in memory."""


class Limits(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The limits of a server. Times are in seconds in which the server runs: a server that was stopped or busy holds nobody to them."""

    connections: Count = 1000
    """Connections of a server. A new one takes the place of the one that has sent no request for the longest time."""
    websockets: Count = 250
    """Those of them that are WebSockets."""
    header_bytes: Count = 64 * 1024
    """The request line and the headers of a request."""
    body_bytes: Count = 32 * 2**20
    """The body of a request at the API and at the windows. A SOAP message is limited by the protocol."""
    bodies_bytes: Count = 64 * 2**20
    """The bodies of all requests together that a server has received and not answered."""
    request_seconds: Count = 20
    """Time for the headers of a request, and again for its body."""
    frame_bytes: Count = 2**20
    """A message on a WebSocket."""
    topics: Count = 200
    """Tasks that one WebSocket follows. All other topics are few."""
    followed_tasks: Count = 500
    """Tasks that all WebSockets of the API follow together."""
    bytes_per_second: Count = 10_000
    """A larger body has as much more time as this rate takes."""
    devices: Count = 5000
    """Devices whose services a Registry lists."""
    subscribers: Count = 1000
    """Those that a Repository, a Registry or a Scheduler sends its news to, and those that wait for news of tasks at a Task Manager."""
    tasks: Count = 10_000
    """Tasks that have not ended, at a Task Manager."""
    send_seconds: Count = 60
    """Time in which a client reads some of its response."""
    sign_in_tries: Count = 3
    """Wrong passwords for one name from one address, or ten times as many from one address, after which each further one doubles the time
    until the next try."""
    sign_in_seconds: Count = 60
    """That time at most."""
    audit_entries: Count = 1_000_000
    """Entries of the audit log. When there are more, the oldest tenth is removed."""
    broker_bytes: Count = 2**30
    """What the servers of a bus keep for who speaks MQTT: retained messages, and those for clients that are away."""
    log_bytes: Count = 64 * 2**20
    """A log file. When it is full, its content goes to a file beside it."""


def limits(environment: Mapping[str, str] = os.environ) -> Limits:
    """The limits according to the environment. Raises UsageError for a variable that sets none."""
    texts = {name.removeprefix(PREFIX).lower(): text for name, text in environment.items() if name.startswith(PREFIX)}
    for field, text in texts.items():
        try:
            msgspec.convert({field: text}, Limits, strict=False)
        except msgspec.ValidationError as error:
            names = ", ".join(f"{PREFIX}{name.upper()}" for name in Limits.__struct_fields__)
            problem = str(error).partition(" - at")[0]
            raise UsageError(f"{PREFIX}{field.upper()}={text} sets no limit: {problem}; the limits are {names}") from None
    return msgspec.convert(texts, Limits, strict=False)
