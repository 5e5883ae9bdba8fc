"""What a Task Manager knows of the reservation of a task."""

from __future__ import annotations

from somrs.kernel.reservations import Reservation
from somrs.protocol.messages.reservations import Claim, ReservationDenied, Reserved, UnderReservation
from somrs.protocol.messages.waits import Holder
from somrs.task_manager.reservations import TaskReservation


def wants(*changes: str) -> Reservation:
    return Reservation(changes=frozenset(changes))


def asking(*changes: str) -> TaskReservation:
    return TaskReservation(requested=wants(*changes), serial=7)


def test_what_is_granted_is_held_and_reports_name_its_number() -> None:
    reservation = asking("Jar1", "Jar2")
    reservation.answered(Reserved(task="a", fence=3, holders=(Holder(task="b", goal="", objects=("Jar2",)),)))
    assert (reservation.held, reservation.under("a")) == (wants("Jar1"), UnderReservation(task="a", fence=3))
    assert reservation.claim("a", "goal", 2) == Claim(task="a", serial=7, fence=3, goal="goal", priority=2, changes=("Jar1",))


def test_who_waits_holds_nothing_and_claims_what_it_waits_for() -> None:
    reservation = asking("Jar1")
    reservation.held = wants("Jar2")
    reservation.answered(ReservationDenied(task="a", holders=(), waits=True))
    assert (reservation.held, reservation.waiting) == (Reservation(), wants("Jar1"))
    claim = reservation.claim("a", "", 0)
    assert claim is not None
    assert (claim.waits, claim.changes) == (True, ("Jar1",))


def test_a_report_after_the_loss_of_a_reservation_still_names_it_so_that_it_can_be_refused() -> None:
    reservation = asking("Jar1")
    reservation.answered(Reserved(task="a", fence=3))
    assert not reservation.lose(2), "that was an earlier one"
    assert reservation.lose(3)
    assert (reservation.held, reservation.under("a")) == (Reservation(), UnderReservation(task="a", fence=3))


def test_a_grant_that_was_lost_before_it_was_heard_of_is_none() -> None:
    reservation = asking("Jar1")
    assert not reservation.lose(3)
    assert reservation.answered(Reserved(task="a", fence=3)) == ReservationDenied(task="a", holders=())
    assert reservation.held == Reservation()
    assert reservation.answered(Reserved(task="a", fence=4)) == Reserved(task="a", fence=4)


def test_without_an_answer_nothing_is_known_and_the_claim_says_so() -> None:
    reservation = asking("Jar1")
    reservation.answered("the Repository does not answer")
    claim = reservation.claim("a", "", 0)
    assert claim is not None
    assert (claim.serial, claim.changes) == (0, ())


def test_a_task_that_has_never_reserved_claims_nothing_and_reports_freely() -> None:
    assert (TaskReservation().claim("a", "", 0), TaskReservation().under("a")) == (None, None)


def test_what_an_earlier_program_had_reserved_is_claimed() -> None:
    claim = TaskReservation(held=wants("Jar1")).claim("a", "", 0)
    assert claim == Claim(task="a", serial=0, changes=("Jar1",))
