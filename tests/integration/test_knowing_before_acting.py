"""Tasks that have to know before they act: objects that have to be found, values that have to be measured, outputs that later steps use."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from somrs.ontology.objects import ValueSet
from somrs.ontology.services import Parameter, ServiceKind, ServiceType
from somrs.ontology.types import RelationType, Value
from somrs.protocol.messages import events
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.knowledge import Definitions, UpdateMap
from somrs.protocol.messages.previews import Preview, Previewed
from somrs.protocol.messages.task_views import TaskView
from somrs.runtime.virtual_time import Work
from somrs.service_manager.sdk.orders import Capability, Order, Profile, ServiceFailed, WorkDone
from tests.support.virtual_system import SITE, Robot, VirtualSystem

OBJECT = Parameter(name="Object", type="Graspable")
WEIGH = ServiceType(
    name="WeighObject",
    kind=ServiceKind.COGNITIVE,
    inputs=(OBJECT,),
    outputs=(Parameter(name="Weight", type="number"),),
    effect="?Object.Weight = ?Weight",
)
CARRY = ServiceType(
    name="CarryWithinPayload",
    inputs=(OBJECT, Parameter(name="Destination", type="Object")),
    precondition="?Object isOn ?Source AND ?Object.Weight <= ?Provider.Payload",
    effect="?Object isOn ?Destination",
)
PICK_PLACE = ServiceType(
    name="PickPlace",
    kind=ServiceKind.SOFTWARE,
    inputs=(OBJECT,),
    outputs=(Parameter(name="Place", type="Support"),),
    effect="?Place isFreeFor ?Object",
)
FREE = RelationType(name="isFreeFor", joins=("Support", "Graspable"))
Script = Callable[[Order], Work]


def finds(situation: str) -> Script:
    def work(order: Order) -> Work:
        yield 3.0, WorkDone(situation=situation)

    return work


def finds_nothing(order: Order) -> Work:
    yield 3.0, ServiceFailed(f"{order.inputs['Object']} is nowhere to be seen")


class KnowingSystem(VirtualSystem):
    """A system in which observers, scales and programs can join."""

    def observe(self, name: str, script: Script, service: str | ServiceType = "RecognizeSituation", price: float = 1.0) -> Robot:
        observer = Robot(name, price, 3, works=script)
        capability = Capability(type=service, method="work", stoppable=True)
        types = Definitions(services=(service,) if isinstance(service, ServiceType) else (), relations=(FREE,))
        values: dict[str, Value] = {"PositionX": 5.0, "PositionY": 5.0, "PositionZ": 0.0}
        profile = Profile(name=name, type="StationaryDevice", capabilities=(capability,), definitions=types, values=values, lease=3600)
        self._join(observer, profile)
        self.world.run(5)
        return observer

    def forget(self, object: str) -> None:
        """Mark an object as unknown, as a person does who does not see it where the map says."""
        self.update(ValueSet(object, "Unknown", True))

    def update(self, *changes: ValueSet) -> None:
        self._question_count += 1
        header = Header(sender="client", recipient="repository", message_id=message_id("client", self._question_count), reply_to="client")
        self.world.send(Message(header=header, body=UpdateMap(changes=changes, author="test")))
        self.world.run(2)

    def events_of(self, task: str, kind: type) -> list[object]:
        return [logged.event for logged in self.manager.state.tasks[task].events if isinstance(logged.event, kind)]


def work_of(view: TaskView) -> list[str]:
    return [f"{work.service}: {work.state}" for work in view.work]


def test_an_object_of_which_nothing_is_known_is_looked_for_and_then_carried() -> None:
    system = KnowingSystem(Robot("Robot1", 4, 20))
    system.observe("Camera9", finds("Jar002 isOn Floor001 AND Jar002.Unknown = FALSE"))
    system.forget("Jar002")
    preview = system.ask(Preview(effect="Jar002 isOn Platform001", quotes=True))
    assert isinstance(preview, Previewed)
    assert [(step.service_type, step.foreseen, step.learns) for step in preview.steps] == [
        ("RecognizeSituation", False, ("Jar002",)),
        ("TransferObject", True, ()),
    ]
    assert preview.price is None, "what the rest costs is known when it is known what there is to do"
    assert preview.outlook is not None
    assert (preview.outlook.least_price, preview.outlook.unknown) == (1, ("step2",)), "the robot has not stated terms so far"
    task = system.submit("Jar002 isOn Platform001")
    system.world.run(1.0)
    first, second = system.view(task).steps
    assert (first.kind, first.foreseen, second.foreseen, second.after) == (ServiceKind.COGNITIVE, False, True, ("step1",))
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED, view.reasons
    assert work_of(view) == ["Camera9.RecognizeSituation: Completed", "Robot1.TransferObject: Completed"]
    assert system.events_of(task, events.Planned) == [events.Planned(steps=2, foreseen=1), events.Planned(steps=1)]
    (found,) = system.events_of(task, events.FoundOut)
    assert found == events.FoundOut(service="Camera9.RecognizeSituation", situation="Jar002 isOn Floor001 AND Jar002.Unknown = FALSE")
    assert not system.events_of(task, events.Replanned), "it is the same plan, completed"
    system.forget("Jar001")
    preview = system.ask(Preview(effect="Jar001 isOn Platform001", quotes=True))
    assert isinstance(preview, Previewed)
    assert preview.outlook is not None
    assert (preview.outlook.least_price, preview.outlook.most_price, preview.outlook.unknown) == (5, 5, ())
    assert preview.outlook.least_seconds == pytest.approx(23, abs=0.5)


def test_that_an_object_be_known_is_a_task() -> None:
    system = KnowingSystem(Robot("Robot1", 4, 20))
    system.observe("Camera9", finds("Jar002 isOn Floor001 AND Jar002.Unknown = FALSE"))
    system.forget("Jar002")
    (view,) = system.finish(system.submit("Jar002.Unknown = FALSE"))
    assert view.outcome is Outcome.ACCOMPLISHED
    assert [step.state for step in view.steps] == [State.COMPLETED]


PARCEL_SITE = (
    "types:\n  Parcel: {parent: Graspable}\n"
    + SITE.replace(
        "facts:\n", "  Parcel001: {type: Parcel, at: [1, 1.2, 0.8], Shape: {Form: Box, Width: 0.1, Depth: 0.1, Height: 0.2}}\nfacts:\n"
    )
    + "  - Parcel001 isOn Cupboard001\n"
)


@pytest.mark.parametrize("recognise", [False, True])
def test_a_weight_that_the_type_forbids_is_named_where_the_task_ends(recognise: bool) -> None:
    system = KnowingSystem(Robot("Robot1", 4, 20), site=PARCEL_SITE)
    system.observe("Scale9", finds("Parcel001.Weight = 7 kg"), WEIGH)
    task = system.submit("Parcel001.Weight = ?Weight", recognise=recognise)
    (view,) = system.finish(task)
    assert view.outcome is Outcome.FAILED
    rule = "Parcel001: for a Graspable, Weight is at most 5, not 7 [constraint]"
    assert system.events_of(task, events.ReportRejected) == [events.ReportRejected(service="Scale9.WeighObject", problems=(rule,))]
    text = f"the Repository rejects what Scale9.WeighObject reports ({rule}); if it is so, change the ontology"
    assert text in view.explanation


def test_looking_at_a_place_puts_nothing_there() -> None:
    see = ServiceType(
        name="SeeWhetherOn",
        kind=ServiceKind.COGNITIVE,
        inputs=(Parameter(name="Thing", type="PhysicalObject"), Parameter(name="Place", type="Object")),
        effect="?Thing isOn ?Place",
    )
    system = KnowingSystem(Robot("Robot1", 4, 20))
    observer = system.observe("Camera9", finds("Jar002 isOn Cupboard001"), see)
    (view,) = system.finish(system.submit("Jar002 isOn Platform001"))
    assert view.outcome is Outcome.ACCOMPLISHED
    assert work_of(view) == ["Robot1.TransferObject: Completed"]
    assert observer.orders == []


def test_who_finds_nothing_is_asked_once_and_then_another() -> None:
    system = KnowingSystem(Robot("Robot1", 4, 20))
    blind = system.observe("Camera9", finds_nothing, price=0.5)
    system.observe("Camera10", finds("Jar002 isOn Floor001 AND Jar002.Unknown = FALSE"), price=9)
    system.forget("Jar002")
    (view,) = system.finish(system.submit("Jar002 isOn Platform001"))
    assert view.outcome is Outcome.ACCOMPLISHED, view.reasons
    assert len(blind.orders) == 1
    assert [entry for entry in work_of(view) if entry.startswith("Camera")] == [
        "Camera9.RecognizeSituation: Failed",
        "Camera10.RecognizeSituation: Completed",
    ]


@pytest.mark.parametrize("script", [finds_nothing, finds("Cupboard001 isOn Floor001")])
def test_what_nobody_finds_is_said(script: Script) -> None:
    system = KnowingSystem(Robot("Robot1", 4, 20))
    blind = system.observe("Camera9", script)
    system.forget("Jar002")
    (view,) = system.finish(system.submit("Jar002 isOn Platform001"))
    assert view.outcome is Outcome.FAILED
    assert "Camera9 could not find it out" in view.explanation
    assert len(blind.orders) == 1


def test_one_that_did_not_find_one_thing_is_still_asked_for_another() -> None:
    def works(order: Order) -> Work:
        if order.inputs["Object"] == "Jar001":
            yield from finds_nothing(order)
        yield 3.0, WorkDone(situation="Jar002 isOn Floor001 AND Jar002.Unknown = FALSE")

    system = KnowingSystem(Robot("Robot1", 4, 20))
    system.observe("Camera9", works)
    system.forget("Jar001")
    system.forget("Jar002")
    (view,) = system.finish(system.submit("Jar001 isOn Platform001 OR Jar002 isOn Platform001"))
    assert view.outcome is Outcome.ACCOMPLISHED, view.reasons


def test_a_robot_that_reports_the_same_impossible_situation_again_is_asked_no_more() -> None:
    def invents_a_place(order: Order) -> Work:
        yield 5.0, WorkDone(situation="Jar002 isOn Nowhere001")

    robot = Robot("Robot1", 4, 20, works=invents_a_place)
    system = KnowingSystem(robot)
    system.observe("Camera9", finds("Jar002 isOn Floor001 AND Jar002.Unknown = FALSE"))
    task = system.submit("Jar002 isOn Platform001")
    (view,) = system.finish(task)
    assert view.outcome is Outcome.FAILED
    assert "Robot1.TransferObject: reported an impossible situation: there is no object Nowhere001 on the map" in view.explanation
    assert len(system.events_of(task, events.ReportRejected)) == len(robot.orders) == 2


@pytest.mark.parametrize("goal", ["Jar002 isOn Platform001", "Jar002.Unknown = FALSE"])
def test_with_nobody_who_looks_the_task_waits_and_goes_on_as_soon_as_somebody_joins(goal: str) -> None:
    system = KnowingSystem(Robot("Robot1", 4, 20))
    system.forget("Jar002")
    task = system.submit(goal)
    system.world.run(600)
    waiting = system.view(task).waiting_to_retry
    assert waiting is not None
    assert [(hindrance.subject, hindrance.reason) for hindrance in waiting.hindrances] == [
        ("RecognizeSituation", "no device offers it now")
    ]
    system.observe("Camera9", finds("Jar002 isOn Floor001 AND Jar002.Unknown = FALSE"))
    (view,) = system.finish(task, seconds=120)
    assert view.outcome is Outcome.ACCOMPLISHED


@pytest.mark.parametrize(("weight", "carrier"), [(1.5, "Robot1"), (4.0, "Robot2"), (4.9, None)])
def test_who_carries_it_depends_on_what_the_scale_says(weight: float, carrier: str | None) -> None:
    site = SITE.replace("  Tin001: {type: Jar,", "  Tin001: {type: Graspable, Shape: {Form: Cylinder, Radius: 0.04, Height: 0.1},").replace(
        "Robot2: {type: PioneerP3DX,", "Robot2: {type: PioneerP3DX, Payload: 4.5,"
    )
    system = KnowingSystem(site=site)

    def weighs(order: Order) -> Work:
        yield 2.0, WorkDone(situation=f"{order.inputs['Object']}.Weight = {weight} kg", outputs={"Weight": weight})

    def carries(order: Order) -> Work:
        yield 20.0, WorkDone(situation=f"{order.inputs['Object']} isOn {order.inputs['Destination']}")

    system.observe("Scale1", weighs, WEIGH)
    for name, price in (("Robot1", 2), ("Robot2", 8)):
        system.join(Robot(name, price, 20, works=carries), service=CARRY)
    system.world.run(5)
    task = system.submit("Tin001 isOn Platform001")
    system.world.run(0.6)
    assert [step.learns for step in system.view(task).steps] == [("Tin001.Weight",), ()]
    (view,) = system.finish(task)
    assert system.events_of(task, events.FoundOut)
    if carrier is None:
        assert view.outcome is Outcome.FAILED
        assert "Tin001.Weight <= " in view.explanation
    else:
        assert view.outcome is Outcome.ACCOMPLISHED, view.reasons
        assert work_of(view) == ["Scale1.WeighObject: Completed", f"{carrier}.CarryWithinPayload: Completed"]
    assert system.map.objects["Tin001"].values["Weight"] == weight


def test_a_value_that_a_program_computes_is_an_input_of_the_next_step() -> None:
    system = KnowingSystem()
    parcel = Parameter(name="Object", type="Graspable")
    text = Parameter(name="Text", type="text")
    compute = ServiceType(name="Compute", kind=ServiceKind.SOFTWARE, inputs=(parcel,), outputs=(text,), effect="?Object.Label = ?Text")
    print_label = ServiceType(
        name="Print", inputs=(parcel, text), precondition="?Object.Label = ?Text", effect='?Object.Texture = "labelled"'
    )
    orders: list[Order] = []

    def computes(order: Order) -> Work:
        yield 0.5, WorkDone(situation=f'{order.inputs["Object"]}.Label = "fragile"', outputs={"Text": "fragile"})

    def prints(order: Order) -> Work:
        orders.append(order)
        yield 1.0, WorkDone(situation=f'{order.inputs["Object"]}.Texture = "labelled"')

    system.observe("Program1", computes, compute)
    system.observe("Printer1", prints, print_label)
    (view,) = system.finish(system.submit('Jar002.Texture = "labelled"'))
    assert view.outcome is Outcome.ACCOMPLISHED, view.reasons
    assert [order.inputs for order in orders] == [{"Object": "Jar002", "Text": '"fragile"'}]


def test_a_program_picks_the_place_to_which_a_robot_carries() -> None:
    system = KnowingSystem(Robot("Robot1", 4, 20))

    def picks(order: Order) -> Work:
        yield 0.5, WorkDone(situation=f"Platform001 isFreeFor {order.inputs['Object']}", outputs={"Place": "Platform001"})

    system.observe("Planner1", picks, PICK_PLACE)
    task = system.submit("Jar002 isOn ?Place AND ?Place isFreeFor Jar002")
    system.world.run(0.6)
    pick, carry = system.view(task).steps
    assert (pick.kind, pick.learns, pick.assumed) == (ServiceKind.SOFTWARE, ("?Place isFreeFor Jar002",), ("Some-Place isFreeFor Jar002",))
    assert (carry.foreseen, carry.inputs) == (True, {"Object": "Jar002", "Destination": "Some-Place"})
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED, view.reasons
    (found,) = system.events_of(task, events.FoundOut)
    assert found == events.FoundOut(
        service="Planner1.PickPlace", situation="Platform001 isFreeFor Jar002", outputs={"Place": "Platform001"}
    )
    assert [fact.arguments for fact in system.map.facts("isOn") if fact.arguments[0] == "Jar002"] == [("Jar002", "Platform001")]
