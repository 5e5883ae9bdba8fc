"""Each component answers every message that its description (WSDL) offers, whatever the message says."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Struct

from somrs.kernel.component import Ask, Component, Received, Send, SetTimer, Started
from somrs.protocol.messages.bodies import REQUESTS
from somrs.protocol.messages.frp import Fault
from somrs.protocol.soap import wsdl
from somrs.registry.component import Registry
from somrs.repository.component import Repository
from somrs.scheduling.component import Scheduler
from somrs.scheduling.state import Located
from somrs.service_manager.participant.participant import ServiceManager
from somrs.task_manager.manager import TaskManager
from tests.support.bodies import messages
from tests.support.examples import examples
from tests.support.lab import contents, lab
from tests.support.service_manager_harness import PROFILE

REPOSITORY, REGISTRY, TASK_MANAGER = (f"http://here/{name}" for name in ("repository", "registry", "task-manager"))

FACTORIES: dict[str, Callable[[str], Component]] = {
    "repository": lambda address: Repository(address, contents()),
    "registry": lambda address: Registry(address, lab()[0], REPOSITORY),
    "task-manager": lambda address: TaskManager(address, repository=REPOSITORY, registry=REGISTRY),
    "scheduler": lambda address: Scheduler(address, Located(REPOSITORY, TASK_MANAGER, "Europe/Warsaw")),
    "devices": lambda address: ServiceManager(PROFILE, repository=REPOSITORY, registry=REGISTRY),
}

OFFERED = [(path, kind) for path in FACTORIES for kind in wsdl.COMPONENTS[path][1]]


@examples(10)
@pytest.mark.parametrize(("path", "kind"), OFFERED, ids=[f"{path}-{kind.__name__}" for path, kind in OFFERED])
@given(data=st.data())
def test_what_is_offered_is_understood(path: str, kind: type[Struct], data: st.DataObject) -> None:
    address = f"http://here/{path}"
    component = FACTORIES[path](address)
    component.handle(Started(address), 0.0)
    message = data.draw(messages(kind))
    effects = component.handle(Received(message), 1.0)
    replies: list[Any] = [
        effect.message.body
        for effect in effects
        if isinstance(effect, Send) and effect.message.header.relates_to == message.header.message_id
    ]
    refusals = [body for body in replies if isinstance(body, Fault) and "ActionNotSupported" in body.code]
    assert not refusals
    if kind in REQUESTS:
        # The reply is sent at once, when the node has answered a question, or at the latest when a timer fires.
        assert replies or any(isinstance(effect, Ask | SetTimer) for effect in effects)
