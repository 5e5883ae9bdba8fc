"""A vehicle that hibernates is there, and wakes up when it is wanted."""

from __future__ import annotations

import itertools

from somrs.adapters.vda5050.control.exchange import Arrived, Broken, Delayed, Halted, Reachable
from somrs.adapters.vda5050.control.policy import Policy
from somrs.adapters.vda5050.control.vehicle import VehicleControl
from somrs.adapters.vda5050.frames import Frames
from somrs.adapters.vda5050.messages.decoding import Received
from somrs.adapters.vda5050.messages.header import Topic, Version
from somrs.adapters.vda5050.messages.orders import Action, BlockingType, InstantActions
from somrs.adapters.vda5050.messages.states import Connection, ConnectionState, State
from somrs.adapters.vda5050.simulated.exchange import Connected, Instructed
from tests.support.vda5050_messages import HEADER
from tests.support.vda5050_pair import Pair

START = Action(action_type="startHibernation", action_id="night", blocking_type=BlockingType.NONE)


def asleep(policy: Policy | None = None) -> Pair:
    """A vehicle that somebody else has sent to sleep."""
    pair = Pair(Version.V3_0, policy=policy)
    pair.forget()
    pair.tell(Instructed(actions=InstantActions(actions=(START,))))
    pair.run(5)
    pair.reported = []
    return pair


def states(pair: Pair) -> list[State]:
    return [message for message in pair.reported if isinstance(message, State)]


def test_a_vehicle_that_hibernates_is_not_lost_and_not_silent() -> None:
    pair = asleep()
    pair.run(120)
    assert states(pair) == []
    assert pair.of(Reachable, Broken) == []
    assert pair.of(Delayed) == [Delayed(reason="hibernates")]
    assert pair.instant_actions() == []


def test_it_wakes_up_to_drive() -> None:
    pair = asleep()
    pair.follow("A", "B")
    pair.run(10)
    assert pair.body.x == 2.0
    assert pair.instant_actions()[0] == "stopHibernation"
    assert pair.of(Delayed)[-1] == Delayed(reason=None)


def test_it_is_woken_again_when_that_is_lost() -> None:
    lost = iter([0, 0])
    pair = asleep()
    pair.fate = lambda topic: next(lost, 1) if topic is Topic.INSTANT_ACTIONS else 1
    pair.follow("A", "B")
    pair.run(20)
    assert pair.body.x == 2.0
    assert pair.instant_actions().count("stopHibernation") == 3


def test_nobody_wakes_it_to_stand_still() -> None:
    pair = asleep()
    pair.halt()
    assert pair.of(Halted) == [Halted()]
    pair.follow("A")
    pair.run(10)
    assert pair.commands == []


def test_one_of_which_nobody_knows_where_it_is_is_woken_once() -> None:
    pair = Pair(Version.V3_0)
    successor, identifiers = Pair(Version.V3_0, lambda topic: 0), itertools.count(1000)
    successor.vehicle, successor.body, successor.fate = pair.vehicle, pair.body, lambda topic: 1
    successor.control = VehicleControl(Frames(), Version.V3_0, lambda: f"id-{next(identifiers)}")
    pair.tell(Instructed(actions=InstantActions(actions=(START,))))
    pair.run(2)
    successor.forget()
    successor.tell(Connected())
    successor.run(5)
    assert successor.control.vehicle.pose is not None
    assert successor.instant_actions().count("stopHibernation") == 1


def test_an_idle_vehicle_hibernates_if_the_site_wants_it_and_not_before() -> None:
    pair = Pair(Version.V3_0, policy=Policy(hibernate_after=60.0))
    pair.follow("A", "B")
    pair.run(50)
    assert "startHibernation" not in pair.instant_actions()
    pair.run(60)
    pair.reported = []
    pair.run(40)
    assert pair.instant_actions().count("startHibernation") == 1
    assert states(pair) == []
    pair.follow("B", "C", first=1)
    pair.run(10)
    assert pair.body.x == 4.0


def test_an_order_that_crosses_the_falling_asleep_is_carried_out() -> None:
    pair = Pair(Version.V3_0, policy=Policy(hibernate_after=60.0))
    for _ in range(1000):
        if "startHibernation" in pair.instant_actions():
            break
        pair.run(0.1)
    pair.follow("A", "B", "C")
    pair.run(20)
    assert pair.body.x == 4.0


def test_an_order_that_it_dropped_to_hibernate_is_driven_to_its_end() -> None:
    pair = Pair(Version.V3_0)
    pair.follow("A", "B", "C")
    pair.run(2.5)
    pair.tell(Instructed(actions=InstantActions(actions=(START,))))
    pair.run(20)
    assert pair.body.x == 4.0
    assert pair.passed() == [1, 2]


def test_vehicles_that_cannot_hibernate_are_not_asked_to() -> None:
    pair = Pair(Version.V2_1, policy=Policy(hibernate_after=10.0))
    pair.run(60)
    assert "startHibernation" not in pair.instant_actions()


def test_who_says_offline_or_broken_is_lost() -> None:
    for connection_state in (ConnectionState.OFFLINE, ConnectionState.CONNECTION_BROKEN):
        pair = asleep()
        message = Connection(connection_state=connection_state)
        pair.do(Arrived(topic=Topic.CONNECTION, received=Received(header=HEADER, message=message)))
        assert pair.of(Reachable) == [Reachable(is_connected=False)]
