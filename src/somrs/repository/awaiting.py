"""What waits for neighbours that do not answer. Clients are told, and the Task Managers of the tasks that wait."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from somrs.kernel.component import Effects
from somrs.ontology.objects import objects_of
from somrs.ontology.qualified_names import home_of, translated
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.neighbours import NeighbourAwaited
from somrs.protocol.messages.reservations import Reserve
from somrs.repository.forwarding import tell
from somrs.repository.state import Contents

ANSWERS_WITHIN = 5.0
"""Seconds within which a neighbour that is there answers."""

REPETITION_TIME = 10.0
"""Seconds after which a neighbour that has not answered is asked again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wait:
    """What waits for the neighbour `map`: a `text` for people, and the `messages` that are not answered, about these objects."""

    map: str
    text: str
    waiting_since: float
    objects: tuple[str, ...]
    messages: tuple[Message, ...]


def waits(contents: Contents, now: float) -> Iterator[Wait]:
    """What has waited for neighbours for longer than it takes to answer."""
    latest_time = now - ANSWERS_WITHIN
    for handover in contents.handovers.values():
        if handover.adopted is None and handover.since <= latest_time:
            count = len(handover.deferred)
            updates = f"; {count} {'update of it waits' if count == 1 else 'updates of it wait'} for that" if count else ""
            text = f"{handover.object} gets its home there as soon as {handover.map} answers{updates}"
            yield Wait(
                map=handover.map, text=text, waiting_since=handover.since, objects=(handover.object,), messages=tuple(handover.deferred)
            )
    for forwarded in contents.forwarded.values():
        if forwarded.since <= latest_time:
            map, part = next(iter(forwarded.parts.items()))
            author = getattr(forwarded.message.body, "author", "") or forwarded.message.header.sender
            names = (objects_of(change)[0] for change in part.changes if objects_of(change))
            subjects = tuple(dict.fromkeys(translated(name, map, contents.map.name) for name in names))
            text = f"an update of {', '.join(subjects)} by {author} waits until {map} answers"
            yield Wait(map=map, text=text, waiting_since=forwarded.since, objects=subjects, messages=(forwarded.message,))
    for shared in contents.shared_reservations.values():
        if shared.request_id and shared.since <= latest_time and shared.request is not None and shared.message is not None:
            map, request = shared.waiting[0], shared.request
            text = f"the task {request.goal!r} waits until {map} answers whether it may have its objects"
            objects = tuple(name for name in (*request.changes, *request.relies_on) if home_of(name) == map)
            yield Wait(map=map, text=text, waiting_since=shared.since, objects=objects, messages=(shared.message,))


def notices(contents: Contents, now: float) -> Effects:
    """Tell the Task Managers whose requests wait. A neighbour that has passed a request on sees itself that it is not answered."""
    for wait in waits(contents, now):
        for message in wait.messages:
            task, sender = _task_of(message), message.header.sender
            if task and contents.neighbour_at(sender) is None:
                body = NeighbourAwaited(
                    task=task, request=message.header.message_id, map=wait.map, objects=wait.objects, since=wait.waiting_since
                )
                yield tell(contents, sender, body, now, REPETITION_TIME)


def _task_of(message: Message) -> str:
    """The task for which a message was sent; empty if it was sent for none."""
    match message.body:
        case Reserve(task=task):
            return task
        case UpdateMap(reservation=reservation) if reservation is not None:
            return reservation.task
    return ""
