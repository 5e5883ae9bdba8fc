"""Service types change while the system runs: the newest definition counts, and two definitions of one name are never on offer."""

from __future__ import annotations

from msgspec import structs

from somrs.ontology.services import Parameter, ServiceType
from somrs.protocol.messages.directory import Discover, Discovered, Offer, Publish, Published, ServiceTypesChanged
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.knowledge import Define, Defined, Definitions
from somrs.protocol.messages.previews import Preview, Previewed
from somrs.service_manager.sdk.device import Device, Situation, Task, service
from tests.support.virtual_system import Robot, VirtualSystem

GOAL = "Jar002 isOn Platform001"


def ask(system: VirtualSystem, recipient: str, body: object, seconds: float = 1.0) -> object:
    """Send a request from a client, and return the answer."""
    id = message_id(recipient, system.world.now, type(body).__name__, len(system.client.received))
    header = Header(sender="client", recipient=recipient, message_id=id, reply_to="client")
    system.world.send(Message(header=header, body=body))  # type: ignore[arg-type]  # bodies, as the tests know
    system.world.run(seconds)
    return next(message.body for message in system.client.received if message.header.relates_to == id)


def transfer(system: VirtualSystem) -> ServiceType:
    return system.repository.contents.ontology.services["TransferObject"]


def define(system: VirtualSystem, *service_types: ServiceType, author: str = "Ada") -> None:
    answer = ask(system, "repository", Define(definitions=Definitions(services=service_types), author=author))
    assert isinstance(answer, Defined), answer


def offers(system: VirtualSystem, *, withheld: bool = False) -> Discovered:
    answer = ask(system, "registry", Discover(withheld=withheld))
    assert isinstance(answer, Discovered)
    return answer


def careful(system: VirtualSystem) -> ServiceType:
    """TransferObject, only for working robots."""
    return structs.replace(transfer(system), precondition=f"{transfer(system).precondition} AND ?Provider.Working = TRUE")


def careless(system: VirtualSystem) -> ServiceType:
    """TransferObject, whatever the destination is."""
    return structs.replace(transfer(system), precondition="?Object isOn ?Source")


def test_providers_offer_the_newest_definition_and_plans_use_it() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 30), Robot("Robot2", 20, 30))
    new = careful(system)
    define(system, new)
    system.world.run(5)
    assert {offer.service_type for offer in offers(system).offers} == {new}
    (view,) = system.finish(system.submit(GOAL))
    assert view.outcome is Outcome.ACCOMPLISHED
    assert [available.service_type for available in system.problems[-1].services] == [new]


def test_a_task_that_comes_with_the_change_waits_until_the_providers_have_published_again() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 30))
    new = careful(system)
    header = Header(sender="client", recipient="repository", message_id=message_id("now"), reply_to="client")
    system.world.send(Message(header=header, body=Define(definitions=Definitions(services=(new,)), author="Ada")))
    assert system.world.run(1, lambda: system.manager.state.replica.ontology.services["TransferObject"] == new)
    (view,) = system.finish(system.submit(GOAL))
    assert view.outcome is Outcome.ACCOMPLISHED
    assert [[available.service_type for available in problem.services] for problem in system.problems] == [[new]]


def test_a_description_changes_without_a_word_to_the_providers() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 30))
    described = structs.replace(transfer(system), doc="Carry it", cost="2")
    define(system, described)
    assert [offer.service_type for offer in offers(system).offers] == [described]
    assert not any(isinstance(message.body, ServiceTypesChanged) for message in system.world.messages)


def test_a_running_step_is_finished_as_arranged_and_later_ones_follow_the_change() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60))
    task = system.submit("Jar002 isOn Platform001 AND Jar001 isOn Platform001")
    assert system.world.run(60, lambda: any(step.state is State.EXECUTING for step in system.view(task).steps))
    new = careful(system)
    define(system, new)
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert len(view.work) == 2, "nothing is done twice"


def test_open_steps_are_planned_again() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60, mute=True))
    task = system.submit(GOAL)
    system.world.run(3)
    new = careful(system)
    define(system, new)
    system.world.run(2)
    assert [[available.service_type for available in problem.services] for problem in system.problems][1:] == [[new]]
    assert "TransferObject is defined anew" in str(system.manager.state.tasks[task].events)


def test_a_preview_follows_the_change() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60, mute=True))
    header = Header(sender="client", recipient="tm", message_id=message_id("preview"), reply_to="client")
    system.world.send(Message(header=header, body=Preview(effect=GOAL, quotes=True)))
    system.world.run(0.5)
    define(system, careful(system))
    system.world.run(20)
    (answer,) = (m.body for m in system.client.received if m.header.relates_to == header.message_id)
    assert isinstance(answer, Previewed)
    assert len(system.problems) == 2
    assert "Robot1.Working" in str(system.problems[-1].services[0].service_type.precondition).replace("?Provider", "Robot1")


def foreign_offer(service_type: ServiceType, provider: str = "Robot3") -> Publish:
    offer = Offer(
        service=f"{provider}.{service_type.name}",
        provider=provider,
        provider_type="PioneerP3DX",
        address="client",
        service_type=service_type,
    )
    return Publish(provider=provider, offers=(offer,), lease=600)


def test_a_foreign_provider_is_told_and_its_outdated_offer_is_withheld_until_it_publishes_again() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 30))
    old, new = transfer(system), careless(system)
    published = ask(system, "registry", foreign_offer(old))
    assert isinstance(published, Published)
    assert published.withheld == ()
    define(system, new)
    told = [message.body for message in system.client.received if isinstance(message.body, ServiceTypesChanged)]
    assert told == [ServiceTypesChanged(provider="Robot3", service_types=("TransferObject",))]
    assert [offer.service for offer in offers(system).offers] == ["Robot1.TransferObject"]
    assert [offer.service_type for offer in offers(system, withheld=True).offers] == [old]
    published = ask(system, "registry", foreign_offer(old))
    assert isinstance(published, Published)
    (withheld,) = published.withheld
    assert "its precondition is ?Object isOn ?Source AND ?Destination.Supporting = TRUE, not ?Object isOn ?Source" in withheld.reason
    assert "Robot1 offers it so" in withheld.reason
    published = ask(system, "registry", foreign_offer(new))
    assert isinstance(published, Published)
    assert published.withheld == ()
    assert len(offers(system).offers) == 2


def test_a_foreign_provider_that_demands_less_stays_on_offer_with_the_new_definition() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 30))
    old, new = transfer(system), careful(system)
    for outdated in (careless(system), old):
        published = ask(system, "registry", foreign_offer(outdated))
        assert isinstance(published, Published)
        assert published.withheld == ()
    define(system, new)
    assert not any(isinstance(message.body, ServiceTypesChanged) for message in system.client.received)
    assert [offer.service_type for offer in offers(system).offers] == [new, new]


def test_of_a_type_that_only_providers_define_the_first_definition_counts() -> None:
    system = VirtualSystem()
    wave = ServiceType(name="Wave", effect="?Provider.Working = TRUE")
    other_wave = structs.replace(wave, effect="?Provider.Working = FALSE")
    ask(system, "registry", foreign_offer(wave, "Robot3"))
    published = ask(system, "registry", foreign_offer(other_wave, "Robot4"))
    assert isinstance(published, Published)
    assert "Robot3 offers it so" in published.withheld[0].reason
    assert [offer.provider for offer in offers(system).offers] == ["Robot3"]
    ask(system, "registry", Publish(provider="Robot3", offers=(), lease=600))
    assert [offer.provider for offer in offers(system).offers] == ["Robot4"]


def test_a_device_that_brings_another_definition_of_a_name_in_use_is_told_so_and_how_to_go_on() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 30))
    mine = structs.replace(transfer(system), effect="?Object isIn ?Destination")
    system.join(Robot("Robot2", 5, 30), service=mine)
    system.world.run(5)
    (report,) = [line for line in system.reports if line.startswith("Robot2")]
    assert "Robot2 cannot join: TransferObject: is defined otherwise already, by the ontology of the building" in report
    assert "its effect is ?Object isIn ?Destination, not ?Object isOn ?Destination" in report
    assert "somrs ontology import" in report
    assert [offer.provider for offer in offers(system).offers] == ["Robot1"]


def test_a_change_by_an_editor_outlasts_the_restart_of_the_device_that_brought_the_definition() -> None:
    system = VirtualSystem()
    polish = ServiceType(name="Polish", effect="?Provider.Working = TRUE", doc="Make it shine")
    robot = Robot("Robot2", 5, 30)
    system.join(robot, service=polish)
    system.world.run(5)
    described = structs.replace(polish, doc="Polish the floor")
    define(system, described)
    system.restart(robot)
    system.world.run(60)
    assert [offer.service_type for offer in offers(system).offers] == [described]


def test_a_device_whose_author_wrote_another_definition_stays_without_that_service_until_they_agree_again() -> None:
    system = VirtualSystem()
    polish = ServiceType(name="Polish", effect="?Provider.Working = TRUE")
    system.join(Robot("Robot2", 5, 30), service=polish)
    system.world.run(5)
    assert len(offers(system).offers) == 1
    define(system, structs.replace(polish, effect="?Provider.Working = FALSE"))
    system.world.run(5)
    assert offers(system).offers == ()
    assert "Robot2.Polish is not on offer: Polish: its effect is" in system.reports[-1]
    define(system, polish)
    system.world.run(5)
    assert len(offers(system).offers) == 1


def test_a_device_may_revise_its_own_definition() -> None:
    system = VirtualSystem()
    system.join(Robot("Robot2", 5, 30), service=ServiceType(name="Polish", effect="?Provider.Working = TRUE"))
    system.world.run(5)
    revised = ServiceType(name="Polish", effect="?Provider.Working = FALSE")
    system.join(Robot("Robot2", 5, 30), service=revised)
    system.world.run(5)
    assert [offer.service_type for offer in offers(system).offers] == [revised]


class Stower(Device):
    """Reads the inputs of PutInto as the upper ontology names them."""

    type = "PioneerP3DX"

    @service("PutInto", duration="1 s", inputs=("Object", "Cupboard"))
    async def put_into(self, task: Task) -> Situation:
        return f"{task.inputs['Object']} isIn {task.inputs['Cupboard']}"

    @service("MoveTo", duration="1 s", inputs=("Place",))
    async def move_to(self, task: Task) -> Situation:
        return f"{self.name} isAt {task.inputs['Place']}"


def test_a_service_whose_inputs_a_site_names_otherwise_is_withheld_and_the_others_are_on_offer() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 30))
    shipped = system.repository.contents.ontology.services["PutInto"]
    renamed = structs.replace(
        shipped,
        inputs=(Parameter(name="Item", type="Graspable"), Parameter(name="Cupboard", type="Cupboard")),
        precondition="?Item isOn ?Source",
        effect="?Item isIn ?Cupboard",
    )
    define(system, renamed)
    system.join_device(Stower("Robot2"))
    system.world.run(5)
    found = offers(system, withheld=True)
    assert [offer.service for offer in found.offers] == ["Robot2.PutInto"]
    assert "its inputs are Object: Graspable, Cupboard: Cupboard, not Item: Graspable, Cupboard: Cupboard" in found.withheld[0].reason
    assert "Robot2.MoveTo" in {offer.service for offer in offers(system).offers}
    define(system, shipped)
    system.world.run(60)
    assert "Robot2.PutInto" in {offer.service for offer in offers(system).offers}
    define(system, renamed)
    system.world.run(60)
    assert "Robot2.PutInto" not in {offer.service for offer in offers(system).offers}
