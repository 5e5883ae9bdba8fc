"""Which messages programs of neighbours may send here: each type, from each role to each role."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec import Struct, structs

from somrs.errors import WireError
from somrs.protocol.messages import directory, frp, knowledge, neighbours, reservations, submission
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.neighbour_rights import NEIGHBOUR_RIGHTS, check_neighbour_right, is_of_components
from somrs.protocol.messages.rights import BODY_TYPES, DENIED, RIGHTS
from somrs.trust.identity import Identity, Role
from tests.support.bodies import KINDS, messages

BETWEEN: dict[tuple[Role, Role], set[type[Any]]] = {
    (Role.TASK_MANAGER, Role.DEVICE): {
        *(frp.Arrange, frp.Accept, frp.Cancel, frp.Execute, frp.Stop, frp.Compensate, frp.End, frp.Query, frp.Fault),
    },
    (Role.DEVICE, Role.TASK_MANAGER): {
        *(frp.Terms, frp.Refuse, frp.Progress, frp.Completed, frp.Failed, frp.Stopped, frp.Compensated, frp.Stranded),
        *(frp.Status, frp.Query, frp.Fault),
    },
    (Role.REGISTRY, Role.REGISTRY): {
        *(directory.Discover, directory.SubscribeServices, directory.Discovered, directory.ServicesSubscribed),
        *(directory.ServicesJoined, directory.ServicesLeft, frp.Fault),
    },
    (Role.REPOSITORY, Role.REPOSITORY): {
        *(knowledge.ReadOntology, knowledge.ReadMap, knowledge.SubscribeMap, knowledge.UpdateMap),
        *(knowledge.OntologyPage, knowledge.MapPage, knowledge.MapSubscribed, knowledge.Updated, knowledge.Rejected),
        *(knowledge.MapChanged, knowledge.OntologyChanged, frp.Fault),
        *(reservations.Reserve, reservations.Release, reservations.Reserved, reservations.ReservationDenied),
        *(reservations.ReservationFree, reservations.ReservationLost),
        *(neighbours.Adopt, neighbours.Adopted, neighbours.AdoptionRefused),
    },
    (Role.TRAFFIC, Role.REPOSITORY): {knowledge.ReadOntology, knowledge.ReadMap, knowledge.SubscribeMap, frp.Fault},
    (Role.REPOSITORY, Role.TRAFFIC): {
        *(knowledge.OntologyPage, knowledge.MapPage, knowledge.MapSubscribed, knowledge.MapChanged, knowledge.OntologyChanged, frp.Fault),
    },
}
"""All that passes between neighbours."""


def neighbour(*roles: Role, name: str = "BarnRobot", speaks_for: tuple[str, ...] = ()) -> Identity:
    return Identity(name=name, roles=frozenset(roles), speaks_for=frozenset(speaks_for), site="Barn")


def from_participant(message: Message, device: str = "Barn:BarnRobot") -> Message:
    return structs.replace(message, header=structs.replace(message.header, participant=f"{device}.Work#s1"))


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=1, suppress_health_check=[*HealthCheck], deadline=None)
@given(data=st.data())
def test_what_is_not_in_the_table_is_denied_for_all_roles(kind: type[Struct], data: st.DataObject) -> None:
    message = from_participant(data.draw(messages(kind)))
    for sender in Role:
        for recipient in Role:
            if recipient is Role.GATEWAY:
                is_allowed = any(kind in kinds for (one, _), kinds in BETWEEN.items() if one is sender)
            else:
                is_allowed = kind in BETWEEN.get((sender, recipient), set())
            if is_allowed:
                check_neighbour_right(message, neighbour(sender), {recipient})
            else:
                with pytest.raises(WireError, match=rf"Barn:BarnRobot \({sender}\) may not send {kind.__name__}") as error:
                    check_neighbour_right(message, neighbour(sender), {recipient})
                assert error.value.code == DENIED


def test_a_neighbour_may_send_nothing_that_an_own_program_with_the_role_may_not() -> None:
    for kind, passages in NEIGHBOUR_RIGHTS.items():
        assert {passage.sender for passage in passages} <= {*RIGHTS[kind]}, kind


@pytest.mark.parametrize("kind", [submission.Submit, submission.CancelTask, knowledge.Define, knowledge.Undo, directory.Publish])
def test_neighbours_are_no_clients(kind: type[Any]) -> None:
    assert kind in BODY_TYPES
    assert kind not in NEIGHBOUR_RIGHTS


@pytest.mark.parametrize(
    ("device", "identity", "is_allowed"),
    [
        ("Barn:BarnRobot", neighbour(Role.DEVICE), True),
        ("BarnRobot", neighbour(Role.DEVICE), True),  # the barn has no map
        ("Barn:Helper", neighbour(Role.DEVICE, speaks_for=("Helper",)), True),
        ("Barn:Helper", neighbour(Role.DEVICE), False),
        ("Yard:BarnRobot", neighbour(Role.DEVICE), False),
        ("Robot1", neighbour(Role.DEVICE), False),
        ("", neighbour(Role.DEVICE), False),
        ("Robot1", neighbour(Role.DEVICE, Role.REGISTRY, Role.TASK_MANAGER), False),
    ],
)
def test_a_device_reports_for_itself(device: str, identity: Identity, is_allowed: bool) -> None:
    participant = f"{device}.Work#s1" if device else None
    header = Header(sender="https://a/b", recipient="https://c/d", message_id="urn:x", participant=participant)
    message = Message(header=header, body=frp.Completed(situation=""))
    if is_allowed:
        check_neighbour_right(message, identity, {Role.TASK_MANAGER})
        return
    with pytest.raises(WireError, match=f"Barn:BarnRobot may not speak for {device or 'nobody'}, as this Completed does"):
        check_neighbour_right(message, identity, {Role.TASK_MANAGER})


def test_repositories_and_registries_are_known_by_their_addresses() -> None:
    assert all(is_of_components(kind) for kind in BETWEEN[Role.REPOSITORY, Role.REPOSITORY] - {frp.Fault})
    assert all(is_of_components(kind) for kind in BETWEEN[Role.REGISTRY, Role.REGISTRY] - {frp.Fault})
    assert not any(is_of_components(kind) for kind in BETWEEN[Role.DEVICE, Role.TASK_MANAGER])
