"""The simulated vehicle does what the text of VDA 5050 says, and refuses what it does not have."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import msgspec
import pytest

from somrs.adapters.vda5050.messages.header import Topic, Version
from somrs.adapters.vda5050.messages.orders import (
    Action,
    ActionParameter,
    BlockingType,
    Deviation,
    Edge,
    InstantActions,
    Node,
    NodePosition,
    Order,
    Trajectory,
)
from somrs.adapters.vda5050.messages.states import ActionStatus, ErrorLevel, OperatingMode, State
from somrs.adapters.vda5050.simulated.body import Drive, StandInBody
from somrs.adapters.vda5050.simulated.exchange import Act, Connected, Felt, Garbled, Input, Instructed, Ordered, Publish, Switched
from somrs.adapters.vda5050.simulated.factsheet import factsheet
from somrs.adapters.vda5050.simulated.vehicle import SimulatedVehicle

VERSIONS = pytest.mark.parametrize("version", [Version.V2_1, Version.V3_0])


class Alone:
    """A simulated vehicle with its body, in virtual time."""

    def __init__(self, version: Version, **options: Any) -> None:
        self.vehicle = SimulatedVehicle(version, factsheet(), map_id="hall", **options)
        self.body, self.now = StandInBody(), 0.0
        self.published: list[Publish] = []
        self.drives: list[Drive] = []
        self.tell(Connected())
        self.run(0.1)

    def tell(self, input: Input) -> None:
        for effect in self.vehicle.handle(input, self.now):
            match effect:
                case Act(number=number, command=command):
                    self.body.begin(number, command)
                    self.drives.extend([command] if isinstance(command, Drive) else [])
                case Publish():
                    self.published.append(effect)

    def run(self, seconds: float) -> None:
        for _ in range(round(10 * seconds)):
            self.now += 0.1
            self.tell(Felt(sensed=self.body.sense(self.now)))

    def order(self, order: Order) -> None:
        self.tell(Ordered(order=order))

    def act(self, action_type: str, action_id: str, **parameters: object) -> None:
        keys = tuple(ActionParameter(key=key, value=value) for key, value in parameters.items())
        action = Action(action_type=action_type, action_id=action_id, blocking_type=BlockingType.NONE, action_parameters=keys or None)
        self.tell(Instructed(actions=InstantActions(actions=(action,))))

    def status(self, action_id: str) -> ActionStatus:
        state = self.state.action(action_id)
        assert state is not None
        return state.action_status

    @property
    def state(self) -> State:
        return self.vehicle.state()

    @property
    def errors(self) -> list[tuple[str, ErrorLevel]]:
        return [(error.error_type, error.error_level) for error in self.state.errors]


def action(action_type: str, action_id: str, blocking: BlockingType = BlockingType.HARD) -> Action:
    return Action(action_type=action_type, action_id=action_id, blocking_type=blocking)


def order(names: str, *, update: int = 0, base: int | None = None, first: int = 0, order_id: str = "o", **actions: Action) -> Order:
    """An order along the x axis: `A` at 0 m, `B` at 1 m. `base`: how many nodes are released. `actions`: by the names of their nodes."""
    count = len(names) if base is None else base
    nodes = tuple(
        Node(
            node_id=name,
            sequence_id=first + 2 * index,
            released=index < count,
            actions=(actions[name],) if name in actions else (),
            node_position=NodePosition(x=float(ord(name) - ord("A")), y=0.0, map_id="hall"),
        )
        for index, name in enumerate(names)
    )
    edges = tuple(
        Edge(
            edge_id=start.node_id + end.node_id,
            sequence_id=start.sequence_id + 1,
            released=end.released,
            actions=(),
            start_node_id=start.node_id,
            end_node_id=end.node_id,
        )
        for start, end in pairwise(nodes)
    )
    return Order(order_id=order_id, order_update_id=update, nodes=nodes, edges=edges)


def changed(order: Order, index: int, **changes: Any) -> Order:
    """An order with another node."""
    nodes = [*order.nodes]
    nodes[index] = msgspec.structs.replace(nodes[index], **changes)
    return msgspec.structs.replace(order, nodes=tuple(nodes))


def changed_edge(order: Order, index: int, **changes: Any) -> Order:
    edges = [*order.edges]
    edges[index] = msgspec.structs.replace(edges[index], **changes)
    return msgspec.structs.replace(order, edges=tuple(edges))


TRAJECTORY = Trajectory(control_points=(), degree=1, knot_vector=())

REJECTED_WHEN_IDLE = [
    (msgspec.structs.replace(order("AB"), edges=()), "validationError", "VALIDATION_FAILURE"),
    (msgspec.structs.replace(order("A"), nodes=()), "validationError", "VALIDATION_FAILURE"),
    (order("AB", first=2), "validationError", "VALIDATION_FAILURE"),
    (changed(order("ABC"), 1, sequence_id=3), "validationError", "VALIDATION_FAILURE"),
    (changed_edge(order("ABC"), 1, sequence_id=5), "validationError", "VALIDATION_FAILURE"),
    (changed(order("AB"), 0, released=False), "validationError", "VALIDATION_FAILURE"),
    (changed(order("ABC"), 1, released=False), "validationError", "VALIDATION_FAILURE"),
    (changed_edge(order("AB"), 0, released=False), "validationError", "VALIDATION_FAILURE"),
    (order("AB", A=action("pick", "x"), B=action("drop", "x")), "validationError", "VALIDATION_FAILURE"),
    (changed_edge(order("AB"), 0, trajectory=TRAJECTORY), "orderError", "UNSUPPORTED_PARAMETER"),
    (order("AB", B=action("dance", "d")), "orderError", "INVALID_ORDER_ACTION"),
    (changed(order("AB"), 1, node_position=NodePosition(x=1.0, y=0.0, map_id="attic")), "orderError", "UNKNOWN_MAP_ID"),
    (order("CD"), "orderError", "START_NODE_OUT_OF_RANGE"),
]


@VERSIONS
@pytest.mark.parametrize(("bad", "type_in_2", "type_in_3"), REJECTED_WHEN_IDLE)
def test_an_order_that_is_not_valid_is_rejected_until_one_is(bad: Order, type_in_2: str, type_in_3: str, version: Version) -> None:
    vehicle = Alone(version)
    vehicle.order(bad)
    vehicle.run(3)
    level = ErrorLevel.CRITICAL if version is Version.V3_0 and type_in_3 == "UNSUPPORTED_PARAMETER" else ErrorLevel.WARNING
    assert vehicle.errors == [(type_in_3 if version is Version.V3_0 else type_in_2, level)]
    assert vehicle.state.errors[0].reference("orderId") == "o"
    assert (vehicle.state.order_id, vehicle.body.x) == ("", 0.0)
    vehicle.order(order("AB", order_id="good"))
    vehicle.run(3)
    assert (vehicle.errors, vehicle.body.x) == ([], 1.0)


@VERSIONS
@pytest.mark.parametrize(
    ("update", "type_in_2", "type_in_3"),
    [
        (order("AB", order_id="other"), "orderError", "OTHER_ORDER_ACTIVE"),
        (order("CD", update=0, first=4), "orderUpdateError", "OUTDATED_ORDER_UPDATE"),
        (order("CE", update=1, first=4), "orderUpdateError", "SAME_ORDER_UPDATE_ID"),
        (order("BD", update=2, first=2), "orderUpdateError", "VALIDATION_FAILURE"),
    ],
)
def test_an_update_that_does_not_fit_is_rejected_and_the_order_goes_on(
    update: Order, type_in_2: str, type_in_3: str, version: Version
) -> None:
    vehicle = Alone(version)
    vehicle.order(order("AB", base=2))
    vehicle.order(order("BC", update=1, first=2))
    vehicle.order(update)
    assert vehicle.errors == [(type_in_3 if version is Version.V3_0 else type_in_2, ErrorLevel.WARNING)]
    vehicle.run(4)
    assert (vehicle.state.order_update_id, vehicle.body.x) == (1, 2.0)


@VERSIONS
def test_a_repeated_order_is_ignored(version: Version) -> None:
    vehicle = Alone(version)
    vehicle.order(order("AB"))
    vehicle.run(3)
    vehicle.order(order("AB"))
    vehicle.run(3)
    assert (vehicle.errors, vehicle.body.x, len(vehicle.drives)) == ([], 1.0, 1)


@VERSIONS
def test_a_first_node_may_be_as_far_away_as_its_deviation(version: Version) -> None:
    vehicle = Alone(version)
    position = NodePosition(x=2.0, y=0.0, map_id="hall", allowed_deviation_xy=Deviation(a=2.5, b=2.5, theta=0.0))
    vehicle.order(changed(order("CD"), 0, node_position=position))
    vehicle.run(5)
    assert (vehicle.errors, vehicle.body.x) == ([], 3.0)


@VERSIONS
def test_no_update_is_accepted_after_a_cancellation(version: Version) -> None:
    vehicle = Alone(version)
    vehicle.order(order("ABC", base=2))
    vehicle.run(0.5)
    vehicle.act("cancelOrder", "c1")
    assert vehicle.status("c1") is ActionStatus.RUNNING
    vehicle.run(0.5)
    assert vehicle.status("c1") is ActionStatus.FINISHED
    assert (vehicle.state.node_states, vehicle.state.order_id) == ((), "o")
    vehicle.order(order("BC", update=1, first=2))
    assert vehicle.errors[0][0] == ("ORDER_UPDATE_FOLLOWING_CANCEL" if version is Version.V3_0 else "orderUpdateError")
    vehicle.act("cancelOrder", "c2")
    assert vehicle.status("c2") is ActionStatus.FAILED
    assert ("NO_ORDER_TO_CANCEL" if version is Version.V3_0 else "noOrderToCancel") in [error for error, _ in vehicle.errors]


@VERSIONS
def test_the_state_lists_what_is_to_come(version: Version) -> None:
    vehicle = Alone(version)
    vehicle.order(order("ABCD", base=3, C=action("pick", "p")))
    state = vehicle.state
    assert [node.node_id for node in state.node_states] == ["B", "C", "D"]
    assert [edge.edge_id for edge in state.edge_states] == ["AB", "BC", "CD"]
    assert (state.last_node_id, state.last_node_sequence_id, vehicle.status("p")) == ("A", 0, ActionStatus.WAITING)
    vehicle.run(1.4)
    assert [node.node_id for node in vehicle.state.node_states] == ["C", "D"]
    assert vehicle.state.new_base_request
    vehicle.run(7)
    assert [node.node_id for node in vehicle.state.node_states] == ["D"]
    assert vehicle.status("p") is ActionStatus.FINISHED


@VERSIONS
@pytest.mark.parametrize(("blocking", "stops"), [(BlockingType.NONE, False), (BlockingType.SOFT, True), (BlockingType.HARD, True)])
def test_blocking_types_say_whether_the_vehicle_stops(blocking: BlockingType, stops: bool, version: Version) -> None:
    vehicle = Alone(version)
    vehicle.order(order("ABC", B=action("waitForTrigger", "w", blocking)))
    vehicle.run(5)
    assert vehicle.body.x == (1.0 if stops else 2.0)
    assert vehicle.status("w") is ActionStatus.RUNNING
    vehicle.act("trigger", "t")
    vehicle.run(3)
    assert (vehicle.body.x, vehicle.status("w")) == (2.0, ActionStatus.FINISHED)


@VERSIONS
def test_a_pause_can_be_resumed(version: Version) -> None:
    vehicle = Alone(version)
    vehicle.order(order("ABC"))
    vehicle.run(0.5)
    vehicle.act("startPause", "p1")
    vehicle.run(2)
    assert (vehicle.state.paused, vehicle.state.driving, vehicle.status("p1")) == (True, False, ActionStatus.FINISHED)
    assert vehicle.body.x < 1.0
    vehicle.act("stopPause", "p2")
    vehicle.run(3)
    assert (vehicle.state.paused, vehicle.body.x) == (False, 2.0)


@VERSIONS
def test_a_person_who_takes_over_ends_the_order(version: Version) -> None:
    vehicle = Alone(version)
    vehicle.order(order("ABC", C=action("pick", "p")))
    vehicle.run(0.5)
    vehicle.tell(Switched(mode=OperatingMode.MANUAL))
    vehicle.run(2)
    assert (vehicle.state.node_states, vehicle.status("p")) == ((), ActionStatus.FAILED)
    vehicle.order(order("AB", order_id="next"))
    assert vehicle.errors[0][0] == ("MOBILE_ROBOT_NOT_AVAILABLE" if version is Version.V3_0 else "orderError")


@VERSIONS
def test_what_cannot_be_read_and_what_it_cannot_do_are_reported(version: Version) -> None:
    vehicle = Alone(version)
    vehicle.tell(Garbled(topic=Topic.ORDER, reason="is no JSON"))
    vehicle.act("dance", "d")
    assert vehicle.status("d") is ActionStatus.FAILED
    types = {Version.V2_1: ["validationError", "instantActionError"], Version.V3_0: ["VALIDATION_FAILURE", "INVALID_INSTANT_ACTION"]}
    assert [error for error, _ in vehicle.errors] == types[version]
    vehicle.tell(Ordered(order=order("AB"), deviations=("order.nodes.released is text",)))
    assert vehicle.state.order_id == ""


@VERSIONS
def test_states_come_at_once_when_something_has_changed_and_each_second_otherwise(version: Version) -> None:
    vehicle = Alone(version)
    vehicle.run(1)
    vehicle.published.clear()
    vehicle.run(5)
    assert len(vehicle.published) in (4, 5)
    vehicle.published.clear()
    vehicle.order(order("AB"))
    assert [type(published.message) for published in vehicle.published] == [State]
    vehicle.published.clear()
    vehicle.act("factsheetRequest", "f")
    assert [published.topic for published in vehicle.published] == [Topic.FACTSHEET, Topic.STATE]


@VERSIONS
def test_a_lift_takes_the_vehicle_to_another_map(version: Version) -> None:
    vehicle = Alone(version, maps=("upstairs",))
    upstairs = [
        {"node_position": NodePosition(x=1.0, y=0.0, map_id="upstairs")},
        {"node_position": NodePosition(x=3.0, y=0.0, map_id="upstairs")},
    ]
    vehicle.order(changed(changed(order("ABCD"), 2, **upstairs[0]), 3, **upstairs[1]))
    vehicle.run(5)
    assert (vehicle.body.x, vehicle.state.last_node_id) == (1.0, "B"), "it waits in the cabin"
    vehicle.body.map_id = "upstairs"
    vehicle.run(5)
    assert (vehicle.body.x, vehicle.state.last_node_id) == (3.0, "D")
    position = vehicle.state.mobile_robot_position
    assert position is not None
    assert position.map_id == "upstairs"


@VERSIONS
def test_a_vehicle_that_is_switched_on_says_what_it_carries(version: Version) -> None:
    vehicle = SimulatedVehicle(version, factsheet(), map_id="hall")
    vehicle.handle(Felt(sensed=msgspec.structs.replace(StandInBody().sense(0.0), load="Jar7")), 0.0)
    assert [load.load_id for load in vehicle.state().loads or ()] == ["Jar7"]


@VERSIONS
@pytest.mark.parametrize("action_type", ["pick", "drop"])
def test_a_vehicle_says_what_it_carries_when_its_order_is_cancelled_as_its_work_is_done(version: Version, action_type: str) -> None:
    """Seen with a drop: the load was on the platform, and in the state of the vehicle for ever."""
    vehicle = Alone(version)
    vehicle.body.load = None if action_type == "pick" else "Jar7"
    vehicle.vehicle = SimulatedVehicle(version, factsheet(), map_id="hall")  # one that is switched on with this load
    vehicle.tell(Connected())
    vehicle.run(0.1)
    parameters = (ActionParameter(key="stationType", value="floor"), ActionParameter(key="loadId", value="Jar7"))
    work = Action(action_type=action_type, action_id="work", blocking_type=BlockingType.HARD, action_parameters=parameters)
    vehicle.order(changed(order("A"), 0, actions=(work,)))
    vehicle.run(1.0)
    assert vehicle.status("work") is ActionStatus.RUNNING
    vehicle.body.load = "Jar7" if action_type == "pick" else None
    vehicle.act("cancelOrder", "cancel")
    vehicle.run(1.0)
    assert vehicle.status("work") is ActionStatus.FAILED
    assert [load.load_id for load in vehicle.state.loads or ()] == (["Jar7"] if action_type == "pick" else [])
