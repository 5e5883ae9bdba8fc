"""Who may send which message, by every role."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec import Struct, structs

from somrs.errors import WireError
from somrs.protocol.messages import directory, frp, knowledge, traffic
from somrs.protocol.messages.bodies import REQUESTS, FrpBody
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.people import client_address
from somrs.protocol.messages.rights import BODY_TYPES, DENIED, RIGHTS, check_right, missing_rights
from somrs.protocol.messages.submission import Submit
from somrs.trust.identity import Identity, Role
from tests.support.bodies import KINDS, messages


def sender(*roles: Role, name: str = "Robot1", speaks_for: tuple[str, ...] = ()) -> Identity:
    return Identity(name=name, roles=frozenset(roles), speaks_for=frozenset(speaks_for))


def message(body: Any, participant: str | None = None) -> Message:
    header = Header(sender="http://a/b", recipient="http://c/d", message_id="urn:x", transaction="t1", participant=participant)
    return Message(header=header, body=body)


def test_each_type_of_message_has_a_right() -> None:
    assert {*BODY_TYPES} == {*KINDS} == {*RIGHTS}
    without_stop = {kind: right for kind, right in RIGHTS.items() if kind is not frp.Stop}
    assert missing_rights(without_stop) == ["Stop"]


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=3, suppress_health_check=[*HealthCheck], deadline=None)
@given(data=st.data())
def test_a_role_sends_what_is_its_own_and_nothing_else(kind: type[Struct], data: st.DataObject) -> None:
    drawn = data.draw(messages(kind))
    for role in Role:
        right = RIGHTS[kind].get(role)
        if right is None:
            with pytest.raises(WireError) as error:
                check_right(drawn, sender(role))
            assert error.value.code == DENIED
            text = f"Robot1 ({role}) may not send {kind.__name__}: that is for the roles {', '.join(sorted(RIGHTS[kind]))}"
            assert text in error.value.text
            continue
        spoken_for = [*right(drawn)]
        check_right(drawn, sender(role, name="gateway", speaks_for=tuple(spoken_for)))
        if spoken_for:
            with pytest.raises(WireError, match="may not speak for"):
                check_right(drawn, sender(role, name="somebody else"))


@pytest.mark.parametrize("kind", [kind for kind in BODY_TYPES if kind not in REQUESTS])
def test_a_viewer_and_a_client_bring_no_news(kind: type[Any]) -> None:
    allowed = {frp.Fault}
    assert ({Role.VIEWER, Role.CLIENT} & {*RIGHTS[kind]} == set()) == (kind not in allowed)


@pytest.mark.parametrize("kind", BODY_TYPES)
def test_a_device_gives_no_orders(kind: type[Any]) -> None:
    coordinator_bodies = (frp.Arrange, frp.Accept, frp.Cancel, frp.Execute, frp.Stop, frp.Compensate, frp.End)
    if issubclass(kind, coordinator_bodies):
        assert {*RIGHTS[kind]} == {Role.TASK_MANAGER}
    elif issubclass(kind, FrpBody) and kind not in (frp.Query, frp.Fault):
        assert {*RIGHTS[kind]} == {Role.DEVICE}


@pytest.mark.parametrize(
    ("body", "participant", "identity", "names"),
    [
        (frp.Completed(situation=""), "Robot1.Work#s1", sender(Role.DEVICE), None),
        (frp.Completed(situation=""), "Robot2.Work#s1", sender(Role.DEVICE), "Robot2"),
        (frp.Completed(situation=""), "Robot2.Work#s1", sender(Role.DEVICE, speaks_for=("Robot2",)), None),
        (frp.Completed(situation=""), None, sender(Role.DEVICE), "nobody"),
        (directory.Retract(provider="Robot2"), None, sender(Role.DEVICE), "Robot2"),
        (directory.Publish(provider="Robot1", offers=(), lease=5.0), None, sender(Role.DEVICE), None),
        (knowledge.UpdateMap(author="Robot2"), None, sender(Role.DEVICE), "Robot2"),
        (knowledge.UpdateMap(author="Robot2"), None, sender(Role.DEVICE, Role.TASK_MANAGER), None),
        # What a service has left when no coordinator waits for it, the device reports itself, in the name of the service.
        (knowledge.UpdateMap(author="Robot1.Work"), None, sender(Role.DEVICE), None),
        (knowledge.UpdateMap(author="Robot2.Work"), None, sender(Role.DEVICE), "Robot2"),
        (traffic.LeaveTraffic(robot="Robot2"), None, sender(Role.DEVICE), "Robot2"),
    ],
)
def test_a_device_speaks_for_itself(body: Any, participant: str | None, identity: Identity, names: str | None) -> None:
    if names is None:
        check_right(message(body, participant), identity)
        return
    with pytest.raises(WireError) as error:
        check_right(message(body, participant), identity)
    assert error.value.code == DENIED
    assert f"may not speak for {names}, as this {type(body).__name__} does" in error.value.text


def test_an_offer_of_another_device_is_not_published(small_offer: directory.Offer) -> None:
    body = directory.Publish(provider="Robot1", offers=(small_offer, structs.replace(small_offer, provider="Robot2")), lease=5.0)
    with pytest.raises(WireError, match="may not speak for Robot2"):
        check_right(message(body), sender(Role.DEVICE))


@pytest.fixture
def small_offer() -> directory.Offer:
    from somrs.ontology.services import ServiceType

    work = ServiceType(name="Work", effect="A isOn B")
    return directory.Offer(service="Robot1.Work", provider="Robot1", provider_type="Robot", address="http://a/b", service_type=work)


def test_a_person_s_program_submits_and_a_device_only_in_its_own_name() -> None:
    submission = message(Submit(effect="A isOn B"))
    check_right(submission, sender(Role.CLIENT))
    with pytest.raises(WireError, match=r"Robot1 \(device\) may not speak for b, as this Submit does"):
        check_right(submission, sender(Role.DEVICE))
    own_submission = structs.replace(submission, header=structs.replace(submission.header, sender=client_address("Robot1")))
    check_right(own_submission, sender(Role.DEVICE))
    with pytest.raises(
        WireError, match=r"Robot1 \(task-manager\) may not send Submit: that is for the roles api, client, device, scheduler"
    ):
        check_right(own_submission, sender(Role.TASK_MANAGER))
