"""What a Repository answers to Task Managers that reserve objects, and whom it tells what."""

from __future__ import annotations

import pytest

from somrs.kernel.component import Effect, Received, SetTimer, TimerFired
from somrs.kernel.reservations import LEASE
from somrs.ontology.objects import ValueSet
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import Rejected, RenameObject, SubscribeMap, Updated, UpdateMap
from somrs.protocol.messages.reservations import (
    RESERVED,
    Claim,
    ClaimReservations,
    Release,
    ReservationDenied,
    ReservationFree,
    ReservationLost,
    ReservationMode,
    Reserve,
    Reserved,
    UnderReservation,
)
from somrs.protocol.messages.waits import Holder
from somrs.repository.component import Repository
from somrs.repository.state import ReservationsDue
from tests.support.lab import REPOSITORY, contents, deliver_request, request, sent_bodies

A, B = "http://a/tm", "http://b/tm"
TRY, WAIT, UNDO = ReservationMode.TRY, ReservationMode.WAIT, ReservationMode.UNDO


class ReservationDesk:
    """A Repository, and the messages that its Task Managers send."""

    def __init__(self) -> None:
        self.repository, self.serial = Repository(REPOSITORY, contents()), 0

    def says(self, body: Body, sender: str = A, now: float = 0.0) -> list[object]:
        """All that comes of it."""
        return sent_bodies(deliver_request(self.repository, body, now, sender), object)

    def reserves(
        self, task: str, *changes: str, mode: ReservationMode = TRY, sender: str = A, now: float = 0.0, serial: int | None = None
    ) -> list[object]:
        self.serial += 1
        serial = serial if serial is not None else self.serial
        return self.says(Reserve(task=task, serial=serial, mode=mode, goal=f"goal of {task}", changes=changes), sender, now)

    def releases(self, task: str, sender: str = A, *, ended: bool = True, now: float = 0.0) -> list[object]:
        self.serial += 1
        return self.says(Release(task=task, serial=self.serial, ended=ended), sender, now)

    def reports(self, situation: str, task: str, fence: int, sender: str = A, now: float = 0.0) -> object:
        (answer,) = self.says(UpdateMap(situation=situation, reservation=UnderReservation(task=task, fence=fence)), sender, now)
        return answer


def held_by(task: str, *objects: str, waiting: bool = False) -> tuple[Holder, ...]:
    return (Holder(task=task, goal=f"goal of {task}", objects=objects, waiting=waiting),)


def test_tasks_of_two_task_managers_get_an_object_one_after_the_other() -> None:
    desk = ReservationDesk()
    assert desk.reserves("a", "Jar1") == [Reserved(task="a", fence=1)]
    assert desk.reserves("b", "Jar1", sender=B) == [ReservationDenied(task="b", holders=held_by("a", "Jar1"))]
    assert desk.reserves("b", "Jar1", sender=B, mode=WAIT) == [ReservationDenied(task="b", holders=held_by("a", "Jar1"), waits=True)]
    assert desk.releases("a") == [ReservationFree(task="b")]
    assert desk.reserves("b", "Jar1", sender=B) == [Reserved(task="b", fence=2)]


def test_a_request_that_arrives_again_has_the_same_answer() -> None:
    desk = ReservationDesk()
    message = request(Reserve(task="a", serial=1, mode=TRY, changes=("Jar1",)), A)
    answers = [sent_bodies(desk.repository.handle(Received(message), 0.0), object) for _ in range(2)]
    assert answers == [[Reserved(task="a", fence=1)]] * 2


def test_what_is_older_than_what_is_known_of_a_task_is_not_heeded() -> None:
    desk = ReservationDesk()
    desk.reserves("a", "Jar1", serial=5)
    assert desk.reserves("a", "Jar2", serial=4) == [ReservationDenied(task="a", holders=())]
    assert desk.says(Release(task="a", serial=4, ended=True)) == []
    assert desk.reserves("b", "Jar1", "Jar2", sender=B) == [ReservationDenied(task="b", holders=held_by("a", "Jar1"))]


def test_nobody_reserves_or_releases_for_a_task_of_another_task_manager() -> None:
    desk = ReservationDesk()
    desk.reserves("a", "Jar1")
    (fault,) = desk.reserves("a", "Jar2", sender=B)
    assert isinstance(fault, Fault)
    assert A in fault.text
    desk.releases("a", sender=B)
    assert isinstance(desk.reserves("b", "Jar1", sender=B)[0], ReservationDenied)


def test_a_report_of_a_task_that_has_lost_its_objects_to_another_is_refused_and_says_why() -> None:
    desk = ReservationDesk()
    desk.reserves("a", "Jar1")
    assert isinstance(desk.reports("Jar1 isOn Table2", "a", 1), Updated)
    desk.releases("a", ended=False)
    assert isinstance(desk.reports("Jar1 isOn Table1", "a", 1), Updated), "nobody has taken it, and it is so"
    desk.reserves("b", "Jar1", sender=B)
    answer = desk.reports("Jar1 isOn Table2", "a", 1)
    assert isinstance(answer, Rejected)
    assert [(rule.subject, rule.rule) for rule in answer.broken] == [("Jar1", RESERVED)]
    assert "goal of b" in answer.problems[0]
    assert isinstance(desk.reports("Jar2 isOn Table2", "a", 1), Updated), "what another task does not have is news"
    assert isinstance(desk.reports("Jar1 isOn Table2", "b", 2), Updated)


def test_who_gets_its_objects_again_hears_what_others_have_changed_meanwhile() -> None:
    desk = ReservationDesk()
    desk.reserves("a", "Jar1", "Jar2")
    desk.releases("a", ended=False)
    desk.reserves("b", "Jar1", sender=B)
    desk.reports("Jar1 isOn Table2", "b", 2, B)
    assert desk.reserves("a", "Jar1", "Jar2", mode=UNDO) == [Reserved(task="a", fence=3, overtaken=("Jar1",), holders=held_by("b", "Jar1"))]


@pytest.mark.parametrize("only_seen", [True, False])
def test_what_another_has_only_seen_it_has_not_changed(only_seen: bool) -> None:
    """The device of the first task failed without a word; the second task looks, before it does something."""
    desk = ReservationDesk()
    desk.reserves("a", "Jar1")
    desk.releases("a", ended=False)
    desk.reserves("b", "Jar1", sender=B)
    report = UpdateMap(situation="Jar1 isOn Table2", reservation=UnderReservation(task="b", fence=2, only_seen=only_seen))
    assert isinstance(desk.says(report, B)[0], Updated)
    desk.releases("b", B)
    assert desk.reserves("a", "Jar1", mode=UNDO) == [Reserved(task="a", fence=3, overtaken=() if only_seen else ("Jar1",))]


def test_what_another_had_in_doubt_and_found_as_it_was_is_not_changed() -> None:
    desk = ReservationDesk()
    desk.reserves("a", "Jar1")
    desk.reports("Jar1 isOn Table2", "a", 1)
    desk.releases("a", ended=False)
    desk.reserves("b", "Jar1", sender=B)
    doubt = UpdateMap(changes=(ValueSet("Jar1", "Unknown", True),), reservation=UnderReservation(task="b", fence=2))
    assert isinstance(desk.says(doubt, B)[0], Updated)
    assert isinstance(desk.reports("Jar1 isOn Table2", "b", 2, B), Updated)
    desk.releases("b", B)
    assert desk.reserves("a", "Jar1", mode=UNDO) == [Reserved(task="a", fence=3)]


def test_a_silent_task_manager_loses_what_another_wants_and_is_told() -> None:
    desk = ReservationDesk()
    desk.reserves("a", "Jar1")
    effects = deliver_request(desk.repository, Reserve(task="b", serial=9, mode=WAIT, changes=("Jar1",)), 10.0, B)
    assert SetTimer(ReservationsDue(), LEASE) in effects
    assert _rings(desk, LEASE) == [ReservationFree(task="b")]
    answers = desk.reserves("b", "Jar1", sender=B, now=LEASE, serial=10)
    assert answers == [
        Reserved(task="b", fence=2),
        ReservationLost(task="a", fence=1, holders=(Holder(task="b", goal="", objects=("Jar1",)),)),
    ]


def _rings(desk: ReservationDesk, now: float) -> list[object]:
    effects: list[Effect] = desk.repository.handle(TimerFired(ReservationsDue()), now)
    return sent_bodies(effects, object)


def test_who_follows_the_map_keeps_what_it_has() -> None:
    desk = ReservationDesk()
    desk.reserves("a", "Jar1")
    desk.reserves("b", "Jar1", mode=WAIT, sender=B)
    desk.says(SubscribeMap(lease=60.0), A, LEASE - 1)
    assert _rings(desk, LEASE) == []
    assert isinstance(desk.reserves("c", "Jar1", sender=B, now=LEASE)[0], ReservationDenied)


def test_what_tasks_have_by_the_word_of_their_task_manager_takes_the_place_of_what_was_known() -> None:
    desk = ReservationDesk()
    desk.reserves("a", "Jar1")
    desk.reserves("gone", "Jar2")
    desk.reserves("b", "Table1", sender=B)
    claims = (
        Claim(task="a", serial=1, fence=1, changes=("Jar1",)),
        Claim(task="a2", serial=80, fence=7, changes=("Table1",)),
        Claim(task="a3", serial=81, waits=True, changes=("Jar1",)),
    )
    assert desk.says(ClaimReservations(serial=99, claims=claims)) == [ReservationLost(task="a2", fence=7, holders=held_by("b", "Table1"))]
    assert desk.reserves("b2", "Jar2", sender=B) == [Reserved(task="b2", fence=8)]
    assert desk.says(Release(task="a", serial=100, ended=True)) == [ReservationFree(task="a3")]


def test_a_claim_from_before_a_request_does_not_take_away_what_that_got() -> None:
    desk = ReservationDesk()
    desk.reserves("a", "Jar1", serial=50)
    assert desk.says(ClaimReservations(serial=49)) == []
    assert isinstance(desk.reserves("b", "Jar1", sender=B)[0], ReservationDenied)


def test_a_new_name_of_an_object_is_the_name_in_its_reservation() -> None:
    desk = ReservationDesk()
    desk.reserves("a", "Jar1")
    desk.says(RenameObject(name="Jar1", to="Jar7"), "a person")
    assert desk.reserves("b", "Jar7", sender=B) == [ReservationDenied(task="b", holders=held_by("a", "Jar7"))]
    assert desk.reserves("c", "Jar1", sender=B) == [ReservationDenied(task="c", holders=held_by("a", "Jar7"))]


def test_what_was_said_before_a_task_ended_and_arrives_after_that_reserves_nothing() -> None:
    desk = ReservationDesk()
    desk.reserves("a", "Jar1", serial=1)
    desk.says(Release(task="a", serial=9, ended=True))
    assert desk.reserves("a", "Jar2", serial=8) == [ReservationDenied(task="a", holders=())]
    assert desk.says(ClaimReservations(serial=7, claims=(Claim(task="a", serial=1, fence=1, changes=("Jar1",)),))) == []
    assert desk.reserves("b", "Jar1", "Jar2", sender=B) == [Reserved(task="b", fence=2)]


def test_a_request_that_comes_after_the_end_of_a_task_that_never_had_anything_reserves_nothing() -> None:
    desk = ReservationDesk()
    desk.says(Release(task="a", serial=9, ended=True))
    assert desk.reserves("a", "Jar1", serial=8) == [ReservationDenied(task="a", holders=())]


def test_a_claim_that_does_not_know_of_the_latest_grant_does_not_take_it_back() -> None:
    desk = ReservationDesk()
    desk.reserves("a", "Jar1", serial=1)
    desk.reserves("a", "Jar2", serial=2)  # the answer is on its way
    assert desk.says(ClaimReservations(serial=3, claims=(Claim(task="a", serial=1, fence=1, changes=("Jar1",)),))) == []
    assert desk.reserves("b", "Jar2", sender=B) == [ReservationDenied(task="b", holders=held_by("a", "Jar2"))]
