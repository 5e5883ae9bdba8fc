"""Templates and standing orders go on when their objects get other names."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from somrs.kernel.component import Effect, Received
from somrs.ontology.naming import Renaming, Section
from somrs.ontology.services import Handler, Occasion
from somrs.protocol.messages import orders
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.knowledge import Event, MapChanged, Merging
from somrs.protocol.messages.orders import Blank, Every, OrderSaved, TemplateSaved
from somrs.protocol.messages.submission import Submit
from tests.unit.scheduling.test_component import HOUR, REPOSITORY, SCHEDULER, TICK, JournaledScheduler, ask, scheduler, sent_messages

HOURLY = Every(minutes=60)
IT_IS_TIN001 = Event(version=1, at=1.0, author="Anna", changes=(), merged=(Merging(name="Jar002", into="Tin001"),))
RENAMED = Event(version=1, at=1.0, author="Anna", changes=(), renamed=(Renaming(section=Section.OBJECTS, name="Jar002", to="Tin001"),))


def save_template(target: JournaledScheduler, name: str, task: Submit, *blanks: Blank) -> None:
    assert sent_messages(
        ask(target, orders.SaveTemplate(name=name, saved=TemplateSaved(task=task, blanks=blanks)), 0.0), orders.TemplateKept
    )


def save_order(target: JournaledScheduler, saved: OrderSaved) -> None:
    effects = ask(target, orders.SaveOrder(saved=saved), 0.0, id=f"urn:uuid:{saved.name}")
    assert sent_messages(effects, orders.OrderKept)


def change_map(target: JournaledScheduler, event: Event) -> Sequence[Effect]:
    header = Header(sender=REPOSITORY, recipient=SCHEDULER, message_id=f"urn:uuid:event-{event.version}")
    return target.handle(Received(Message(header=header, body=MapChanged(event=event))), event.at)


def submitted_tasks(target: JournaledScheduler) -> list[Submit]:
    return [message.body for message in sent_messages(target.handle(TICK, HOUR), Submit) if isinstance(message.body, Submit)]


@pytest.mark.parametrize("event", [IT_IS_TIN001, RENAMED])
def test_a_standing_order_follows_its_object(event: Event) -> None:
    target = scheduler()
    handlers = (Handler(on=Occasion.FAILURE, when='Jar002.Label = "Jar002"', effect="Jar002 isOn Platform001"),)
    task = Submit(effect="Jar002 isOn Platform001", precondition="NOT Jar002 isOn Platform001", handlers=handlers, priority=5)
    save_order(target, OrderSaved(name="Often", when=HOURLY, task=task))
    save_order(target, OrderSaved(name="Another", when=HOURLY, task=Submit(effect="Jar001 isOn Platform001"), enabled=False))
    assert sent_messages(ask(target, orders.SubscribeOrders(lease=30.0), 0.0, id="urn:uuid:s"), orders.OrdersSubscribed)
    (news,) = sent_messages(change_map(target, event), orders.OrdersChanged)
    assert news.body == orders.OrdersChanged(orders=True)
    assert {order.name: order.version for order in target.book.orders.values()} == {"Often": 2, "Another": 1}
    new_handlers = (Handler(on=Occasion.FAILURE, when='Tin001.Label = "Jar002"', effect="Tin001 isOn Platform001"),)
    new_task = Submit(effect="Tin001 isOn Platform001", precondition="NOT Tin001 isOn Platform001", handlers=new_handlers, priority=5)
    assert submitted_tasks(target) == [new_task]


def test_a_template_and_its_orders_follow_the_object() -> None:
    target = scheduler()
    task = Submit(effect="Jar002 isOn {Place} AND {Thing}.Weight <= {Most}")
    blanks = Blank(name="Place", type="Support"), Blank(name="Thing", type="Jar", default="Jar002"), Blank(name="Most", type="number")
    save_template(target, "Bring", task, *blanks)
    save_template(
        target, "Label", Submit(effect="{Thing}.Label = {Text}"), Blank(name="Thing", type="Jar"), Blank(name="Text", type="text")
    )
    save_order(target, OrderSaved(name="A", when=HOURLY, template="Bring", values={"Place": "Platform001", "Most": "2 kg"}))
    save_order(target, OrderSaved(name="B", when=HOURLY, template="Label", values={"Thing": "Jar002", "Text": "Jar002"}))
    change_map(target, IT_IS_TIN001)
    assert {name: template.version for name, template in target.book.templates.items()} == {"Bring": 2, "Label": 1}
    assert target.book.templates["Bring"].task.effect == "Tin001 isOn {Place} AND {Thing}.Weight <= {Most}"
    assert [task.effect for task in submitted_tasks(target)] == [
        "Tin001 isOn Platform001 AND Tin001.Weight <= 2 kg",
        'Tin001.Label = "Jar002"',
    ]


def test_what_other_events_say_changes_no_order() -> None:
    target = scheduler()
    save_order(target, OrderSaved(name="Often", when=HOURLY, task=Submit(effect="Jar002  isOn Platform001")))
    before = dict(target.book.orders)
    change_map(target, Event(version=1, at=1.0, author="Anna", changes=(), merged=(Merging(name="Jar009", into="Tin001"),)))
    assert target.book.orders == before
    assert [task.effect for task in submitted_tasks(target)] == ["Jar002  isOn Platform001"], "as it was written"
