"""Which messages programs of neighbours may send here: for each type the roles that may, to which roles, and what they have to keep to.

What the table lacks is denied. Among neighbours, Repositories talk to Repositories, Registries to Registries, and a Task Manager to the
devices that it has contracted.
"""

from __future__ import annotations

from collections.abc import Set
from typing import Any, NamedTuple

from somrs.errors import WireError
from somrs.ontology.qualified_names import SEPARATOR
from somrs.protocol.messages import directory, frp, knowledge, neighbours, reservations
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.rights import DENIED, participant_names
from somrs.trust.identity import Identity, Role


class Passage(NamedTuple):
    """A message passes from programs of a neighbour with the one role to own programs with the other."""

    sender: Role
    recipient: Role


_DEVICE, _TASK_MANAGER, _REPOSITORY, _REGISTRY = Role.DEVICE, Role.TASK_MANAGER, Role.REPOSITORY, Role.REGISTRY
_ORDERS, _REPORTS = Passage(_TASK_MANAGER, _DEVICE), Passage(_DEVICE, _TASK_MANAGER)
_VIEWS, _NEWS = Passage(Role.TRAFFIC, _REPOSITORY), Passage(_REPOSITORY, Role.TRAFFIC)
"""Between a simulator of several maps, which is that of traffic, and the Repositories of these maps."""
_MAPS, _OFFERS = Passage(_REPOSITORY, _REPOSITORY), Passage(_REGISTRY, _REGISTRY)


def _all(passage: Passage, *kinds: type[Any]) -> dict[type[Any], tuple[Passage, ...]]:
    return dict.fromkeys(kinds, (passage,))


NEIGHBOUR_RIGHTS: dict[type[Any], tuple[Passage, ...]] = {
    # The Failure Recovery Protocol.
    **_all(_ORDERS, frp.Arrange, frp.Accept, frp.Cancel, frp.Execute, frp.Stop, frp.Compensate, frp.End),
    **_all(_REPORTS, frp.Terms, frp.Refuse, frp.Progress, frp.Completed, frp.Failed, frp.Stopped, frp.Compensated, frp.Stranded),
    **_all(_REPORTS, frp.Status),
    frp.Query: (_ORDERS, _REPORTS),
    frp.Fault: (_ORDERS, _REPORTS, _MAPS, _OFFERS, _VIEWS, _NEWS),
    # Registries: each follows what the other one gives.
    **_all(_OFFERS, directory.Discover, directory.SubscribeServices, directory.Discovered, directory.ServicesSubscribed),
    **_all(_OFFERS, directory.ServicesJoined, directory.ServicesLeft),
    # Repositories: each follows what the other one shows, and changes, reserves, gives and takes objects.
    **dict.fromkeys((knowledge.ReadOntology, knowledge.ReadMap, knowledge.SubscribeMap), (_MAPS, _VIEWS)),
    **dict.fromkeys((knowledge.OntologyPage, knowledge.MapPage, knowledge.MapSubscribed), (_MAPS, _NEWS)),
    **dict.fromkeys((knowledge.MapChanged, knowledge.OntologyChanged), (_MAPS, _NEWS)),
    **_all(_MAPS, knowledge.UpdateMap, knowledge.Updated, knowledge.Rejected),
    **_all(_MAPS, reservations.Reserve, reservations.Release, reservations.Reserved, reservations.ReservationDenied),
    **_all(_MAPS, reservations.ReservationFree, reservations.ReservationLost),
    **_all(_MAPS, neighbours.Adopt, neighbours.Adopted, neighbours.AdoptionRefused),
}
"""What passes between neighbours, by the type of message."""


def check_neighbour_right(message: Message, identity: Identity, recipient: Set[Role]) -> None:
    """Raises WireError with the code `DENIED`, which says why, if a program of a neighbour may not send a message to a program with these
    roles. A gateway passes messages on to programs of all roles, which check them again."""
    kind = type(message.body)
    passages = NEIGHBOUR_RIGHTS.get(kind, ())
    passing = [
        passage
        for passage in passages
        if passage.sender in identity.roles and (passage.recipient in recipient or Role.GATEWAY in recipient)
    ]
    if not passing:
        text = " and ".join(f"from a {passage.sender} to a {passage.recipient}" for passage in passages) or "not at all"
        roles = ", ".join(sorted(identity.roles))
        raise WireError(DENIED, f"{identity.full_name} ({roles}) may not send {kind.__name__}: between neighbours, it passes {text}")
    if (
        {*passing} == {_REPORTS}
        and kind is not frp.Fault
        and (strange := [name for name in participant_names(message) if not _may_report(identity, name)])
    ):
        names = ", ".join(name or "nobody" for name in strange)
        raise WireError(DENIED, f"{identity.full_name} may not speak for {names}, as this {kind.__name__} does")


def is_of_components(kind: type[Any]) -> bool:
    """Whether only Repositories or Registries of neighbours send this type of message: they know each other by their addresses."""
    return not {_ORDERS, _REPORTS} & {*NEIGHBOUR_RIGHTS.get(kind, ())}


def _may_report(identity: Identity, name: str) -> bool:
    """Whether a device of a neighbour may report as a participant with this name: it may be the name that it has on the map here."""
    return identity.may_speak_for(name.removeprefix(f"{identity.site}{SEPARATOR}"))
