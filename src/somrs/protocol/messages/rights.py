"""Who may send which message: for each type the roles that may, and what each of them has to keep to.

The table is complete: this module does not load if a type of message has no entry. It is checked where messages arrive, for the identity
that the sender has proven, before a component sees the message.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, get_args

from somrs.errors import WireError
from somrs.protocol.messages import (
    bodies,
    directory,
    frp,
    knowledge,
    neighbours,
    orders,
    previews,
    records,
    reservations,
    submission,
    task_news,
    traffic,
)
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.people import person_name
from somrs.trust.identity import Identity, Role

DENIED = "frp:Denied"
"""The fault code of a message that its sender has no right to send."""

Names = Callable[[Message], Iterable[str]]
"""The names in which a message speaks."""

Right = dict[Role, Names]
"""The roles that may send a message, each with the names for which its sender has to speak."""

BODY_TYPES: tuple[type[Any], ...] = tuple(
    kind
    for protocol in (
        bodies.FrpBody,
        bodies.DirectoryBody,
        bodies.KnowledgeBody,
        bodies.ClientBody,
        bodies.OrderBody,
        bodies.TrafficBody,
    )
    for kind in get_args(protocol)
)


def _nobody(message: Message) -> Iterable[str]:
    """The message speaks for its sender."""
    return ()


def participant_names(message: Message) -> Iterable[str]:
    """The device of the participant: `Robot1` of `Robot1.TransferObject#s1`."""
    service = (message.header.participant or "").rpartition("#")[0]
    return (service.rpartition(".")[0],)


def _body_names(*fields: str) -> Names:
    return lambda message: [getattr(message.body, field) for field in fields]


def _author(message: Message) -> Iterable[str]:
    """The device that is the author, or whose service it is: `Robot1` of `Robot1.TransferObject`."""
    body = message.body
    assert isinstance(body, knowledge.Define | knowledge.UpdateMap), "the table has this for these"
    return (body.author.partition(".")[0],)


def _client(message: Message) -> Iterable[str]:
    """The client that the task is of."""
    return (person_name(message.header.sender),)


def _publisher(message: Message) -> Iterable[str]:
    body = message.body
    assert isinstance(body, directory.Publish), "the table has this for Publish"
    return (body.provider, *(offer.provider for offer in body.offers))


def _sent_by(*roles: Role) -> Right:
    return dict.fromkeys(roles, _nobody)


_DEVICE, _TASK_MANAGER, _REPOSITORY, _REGISTRY = Role.DEVICE, Role.TASK_MANAGER, Role.REPOSITORY, Role.REGISTRY
_ANYONE = _sent_by(*(role for role in Role if role is not Role.THING))
_PEOPLE = _sent_by(Role.API, Role.CLIENT)
"""Programs that act for people."""
_OF_TASK_MANAGERS, _OF_REPOSITORIES, _OF_REGISTRIES = _sent_by(_TASK_MANAGER), _sent_by(_REPOSITORY), _sent_by(_REGISTRY)
_OF_SCHEDULERS, _OF_TRAFFIC = _sent_by(Role.SCHEDULER), _sent_by(Role.TRAFFIC)
_OF_PARTICIPANT: Right = {_DEVICE: participant_names}
_OF_PROVIDER: Right = {_DEVICE: _body_names("provider")}
_OF_ROBOT: Right = {_DEVICE: _body_names("robot")}
_OF_PASSAGE: Right = {_DEVICE: _body_names("passage")}
_OF_AUTHOR: Right = {_DEVICE: _author}
_TASKS = _PEOPLE | _OF_SCHEDULERS
_RESERVING = _OF_TASK_MANAGERS | _OF_REPOSITORIES
_CHANGING = _PEOPLE | _OF_REPOSITORIES


def _all(needed_right: Right, *kinds: type[Any]) -> dict[type[Any], Right]:
    return dict.fromkeys(kinds, needed_right)


RIGHTS: dict[type[Any], Right] = {
    # The Failure Recovery Protocol: orders of the coordinator, reports of the participant.
    **_all(_OF_TASK_MANAGERS, frp.Arrange, frp.Accept, frp.Cancel, frp.Execute, frp.Stop, frp.Compensate, frp.End),
    **_all(_OF_PARTICIPANT, frp.Terms, frp.Refuse, frp.Progress, frp.Completed, frp.Failed, frp.Stopped, frp.Compensated, frp.Stranded),
    **_all(_OF_PARTICIPANT, frp.Status),
    **_all(_ANYONE, frp.Query, frp.Fault),
    # The Registry.
    directory.Publish: {_DEVICE: _publisher},
    **_all(_OF_PROVIDER, directory.Renew, directory.Retract),
    **_all(_ANYONE, directory.Discover, directory.SubscribeServices, directory.ReadPresence),
    **_all(_OF_REGISTRIES, directory.Published, directory.Retracted, directory.Discovered, directory.ServicesSubscribed),
    **_all(_OF_REGISTRIES, directory.ServicesJoined, directory.ServicesLeft, directory.PresenceLog, directory.ServiceTypesChanged),
    # The Repository: knowledge.
    **_all(_ANYONE, knowledge.ReadOntology, knowledge.ReadMap, knowledge.QueryMap, knowledge.ReadHistory, knowledge.ReadEvents),
    **_all(_ANYONE, knowledge.SubscribeMap, knowledge.Consider, neighbours.ReadNeighbours),
    **_all(_CHANGING, knowledge.RenameObject, knowledge.MergeObject, knowledge.Undo),
    knowledge.Define: _CHANGING | _OF_AUTHOR,
    knowledge.UpdateMap: _CHANGING | _OF_TASK_MANAGERS | _OF_AUTHOR,
    **_all(_OF_REPOSITORIES, knowledge.OntologyPage, knowledge.Defined, knowledge.MapPage, knowledge.Rows, knowledge.Updated),
    **_all(_OF_REPOSITORIES, knowledge.Rejected, knowledge.History, knowledge.MapSubscribed, knowledge.MapChanged),
    **_all(_OF_REPOSITORIES, knowledge.OntologyChanged, knowledge.Considered, knowledge.Events),
    # The Repository: reservations, and what Repositories say to each other.
    **_all(_RESERVING, reservations.Reserve, reservations.Release, reservations.ClaimReservations, reservations.AssignTask),
    **_all(_OF_REPOSITORIES, reservations.Reserved, reservations.ReservationDenied, reservations.ReservationFree),
    reservations.ReservationLost: _OF_REPOSITORIES,
    reservations.TaskAssigned: _RESERVING,
    **_all(_OF_REPOSITORIES, neighbours.Neighbours, neighbours.Adopt, neighbours.Adopted, neighbours.AdoptionRefused),
    neighbours.NeighbourAwaited: _OF_REPOSITORIES,
    # Clients of a Task Manager.
    **_all(_TASKS | {_DEVICE: _client}, submission.Submit, submission.SubmitOnce),  # a robot has itself charged
    **_all(_TASKS, submission.CancelTask, submission.PauseTask, previews.Preview),
    **_all(_ANYONE, task_news.ReadTasks, task_news.WatchTask, task_news.WatchTasks, task_news.ReadMessages, records.ReadRecords),
    **_all(_OF_TASK_MANAGERS, submission.Submitted, submission.TaskRejected, submission.Cancelling, submission.TaskPaused),
    **_all(_OF_TASK_MANAGERS, task_news.Tasks, task_news.TaskNews, task_news.TasksNews, task_news.Messages),
    **_all(_OF_TASK_MANAGERS, previews.Previewed, records.Records),
    # The Scheduler.
    **_all(_ANYONE, orders.ReadTemplates, orders.ReadOrders, orders.ReadRuns, orders.SubscribeOrders),
    **_all(_PEOPLE, orders.SaveTemplate, orders.RenameTemplate, orders.RemoveTemplate, orders.FillTemplate),
    **_all(_PEOPLE, orders.SaveOrder, orders.TurnOrder, orders.RemoveOrder),
    **_all(_OF_SCHEDULERS, orders.TemplatesPage, orders.TemplateKept, orders.TemplateFilled, orders.OrdersPage, orders.OrderKept),
    **_all(_OF_SCHEDULERS, orders.NoLongerKept, orders.RunsPage, orders.OrdersRejected, orders.OrdersSubscribed, orders.OrdersChanged),
    # Traffic.
    **_all(_OF_ROBOT, traffic.EnterTraffic, traffic.ReportPlace, traffic.RequestTrip, traffic.CancelTrip, traffic.LeaveTraffic),
    **_all(_OF_PASSAGE, traffic.EnterPassage, traffic.ReportPassage),
    **_all(_ANYONE, traffic.ReadTraffic, traffic.ReadRoadmap),
    **_all(_OF_TRAFFIC, traffic.TrafficEntered, traffic.TripBegun, traffic.TripEnded, traffic.Granted, traffic.TrafficLeft),
    **_all(_OF_TRAFFIC, traffic.TrafficView, traffic.RoadmapPage, traffic.RoadmapReplaced, traffic.PassageOpen),
    **_all(_OF_TRAFFIC, traffic.PassageClosed, traffic.PassageEntered, traffic.CallPassage, traffic.ReleasePassage),
}
"""The right to send each type of message."""


def missing_rights(rights: Mapping[type[Any], Right]) -> list[str]:
    """The types of messages without an entry in the table."""
    return [kind.__name__ for kind in BODY_TYPES if not rights.get(kind)]


def check_right(message: Message, identity: Identity) -> None:
    """Raises WireError with the code `DENIED`, which says what right is missing, if an identity may not send a message."""
    kind = type(message.body)
    needed_right = RIGHTS[kind]
    permitted = [needed_right[role] for role in identity.roles if role in needed_right]
    if not permitted:
        raise WireError(
            DENIED,
            f"{_text(identity)} may not send {kind.__name__}: that is for the roles {', '.join(sorted(needed_right))}; "
            "a certificate with another role is needed",
        )
    strange_names = [[name for name in names(message) if not identity.may_speak_for(name)] for names in permitted]
    if all(strange_names):
        names = ", ".join(dict.fromkeys(name or "nobody" for name in strange_names[0]))
        raise WireError(
            DENIED, f"{_text(identity)} may not speak for {names}, as this {kind.__name__} does; a certificate that names it is needed"
        )


def _text(identity: Identity) -> str:
    return f"{identity.name} ({', '.join(sorted(identity.roles))})"


if absent := missing_rights(RIGHTS):
    raise TypeError(f"say in {__name__} who may send {', '.join(absent)}")
