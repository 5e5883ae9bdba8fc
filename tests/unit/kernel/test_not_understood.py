"""No component keeps a request waiting that it never answers: what is not for it is refused."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from somrs.api.listener import Listener
from somrs.client.addresses import Addresses
from somrs.client.hub import Hub
from somrs.deployment.shared_map import _Copy
from somrs.devices.simulator.server.follower import Followed, Follower
from somrs.devices.simulator.server.simulated_world import SimulatedWorld
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.kernel.component import Component, Received, Send, Started
from somrs.protocol.messages import frp
from somrs.protocol.messages.bodies import REQUESTS
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message
from somrs.service_manager.participant.participant import ServiceManager
from somrs.service_manager.sdk.orders import Profile
from somrs.traffic.follower import MapFollower
from somrs.traffic.passage_program import PassageProgram
from tests.support.bodies import values_of

ADDRESS, REPOSITORY, REGISTRY, TRAFFIC = (f"http://here/{name}" for name in ("part", "repository", "registry", "traffic"))


def _follower() -> Component:
    return Follower(ADDRESS, REPOSITORY, Followed(SimulatedWorld(WorldKind.KINEMATIC, TRAFFIC), [REPOSITORY]))


COMPONENTS: dict[str, Callable[[], Component]] = {
    "device": lambda: ServiceManager(Profile(name="Robot1", type="Robot", capabilities=()), repository=REPOSITORY, registry=REGISTRY),
    "news": lambda: Listener(ADDRESS, Addresses(repository=REPOSITORY, registry=REGISTRY, task_manager="http://here/tm"), Hub()),
    "simulator": _follower,
    "shared map": lambda: _Copy(ADDRESS, REPOSITORY),
    "traffic's map": lambda: MapFollower(ADDRESS, REPOSITORY),
    "passage": lambda: PassageProgram("Lift1", ADDRESS, TRAFFIC, "1"),
}

KINDS = [kind for kind in REQUESTS if kind is not frp.Query]


@pytest.mark.parametrize("name", COMPONENTS)
@given(body=st.sampled_from(KINDS).flatmap(values_of))
@settings(max_examples=100)
def test_requests_that_are_for_another_component(name: str, body: object) -> None:
    component = COMPONENTS[name]()
    component.handle(Started(ADDRESS), 0.0)
    header = Header(sender=ANONYMOUS, recipient=ADDRESS, message_id="urn:uuid:1", reply_to=ANONYMOUS)
    effects = component.handle(Received(Message(header=header, body=body)), 1.0)  # type: ignore[arg-type]
    answers = [effect.message for effect in effects if isinstance(effect, Send) and effect.message.header.relates_to == "urn:uuid:1"]
    assert [(type(answer.body), answer.body.code) for answer in answers if isinstance(answer.body, frp.Fault)] == [
        (frp.Fault, "wsa:ActionNotSupported")
    ]
