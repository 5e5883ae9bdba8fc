"""What a Scheduler does with requests that come before it has read the map: it is started before, or beside, the Repository."""

from __future__ import annotations

import pytest

from somrs.kernel.component import Effect, Input, Received
from somrs.protocol.messages import orders
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.orders import Blank, Every, OrderSaved, TemplateSaved
from somrs.protocol.messages.submission import Submit
from somrs.repository.component import Repository
from somrs.runtime.virtual_time import World
from somrs.scheduling.component import READY_TIME, SCHEMA, Scheduler
from somrs.scheduling.state import Located
from tests.support.lab import CLIENT, REPOSITORY, contents, request

SCHEDULER, MANAGER = "http://here/scheduler", "http://here/task-manager"
TASK = Submit(effect="Jar1 isOn Table2")
ORDER = orders.SaveOrder(saved=OrderSaved(name="Often", when=Every(minutes=60), task=TASK))
TEMPLATE = orders.SaveTemplate(
    name="Bring", saved=TemplateSaved(task=Submit(effect="{what} isOn Table2"), blanks=(Blank(name="what", type="Jar"),))
)
FILL = orders.FillTemplate(name="Bring", values={"what": "Jar1"})


class RecordingClient:
    """Asks nothing by itself, and keeps the answers, by what they answer: one that was on its way amid a kill comes twice."""

    def __init__(self) -> None:
        self.answers: dict[str | None, Body] = {}

    @property
    def received_answers(self) -> list[Body]:
        return [*self.answers.values()]

    def handle(self, event: Input, now: float) -> list[Effect]:
        match event:
            case Received(Message(header=header, body=body)):
                assert self.answers.setdefault(header.relates_to, body) == body, "each is answered once"
        return []


class House:
    def __init__(self) -> None:
        self.world, self.client = World(), RecordingClient()
        self.world.add(SCHEDULER, Scheduler(SCHEDULER, Located(REPOSITORY, MANAGER)), journaled=SCHEMA)
        self.world.add(CLIENT, self.client)

    def ask(self, body: Body) -> None:
        self.world.send(request(body, recipient=SCHEDULER))


@pytest.mark.parametrize("killed", [False, True])
def test_who_wants_something_before_the_map_is_known_waits_for_it(killed: bool) -> None:
    house = House()
    for body in (ORDER, TEMPLATE, FILL):
        house.ask(body)
        house.world.run(1.0)
    house.ask(orders.ReadOrders())
    house.world.run(1.0)
    assert house.client.received_answers == [orders.OrdersPage(orders=())], "what needs no map is answered at once"
    if killed:
        house.world.kill(SCHEDULER)
        house.world.revive(SCHEDULER)
    house.world.add(REPOSITORY, Repository(REPOSITORY, contents()))
    assert house.world.run(30.0, lambda: len(house.client.received_answers) == 4)
    assert [type(body) for body in house.client.received_answers[1:]] == [orders.OrderKept, orders.TemplateKept, orders.TemplateFilled]
    house.world.run(2 * READY_TIME)
    assert len(house.client.received_answers) == 4


def test_who_wants_something_while_there_is_no_repository_is_told_so() -> None:
    house = House()
    house.ask(ORDER)
    house.world.run(READY_TIME - 1)
    assert not house.client.received_answers
    house.world.run(2.0)
    text = f"the map of the environment is not known yet, because {REPOSITORY} does not answer; try again later"
    assert house.client.received_answers == [Fault(code="env:Receiver", text=text)]
    house.world.add(REPOSITORY, Repository(REPOSITORY, contents()))
    house.world.run(60.0)
    house.ask(orders.ReadOrders())
    house.world.run(1.0)
    assert house.client.received_answers[1:] == [orders.OrdersPage(orders=())], "what was refused is not done later"
