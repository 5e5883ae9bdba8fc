"""What a robot makes of the messages of traffic."""

from __future__ import annotations

from somrs.protocol.messages.traffic import Granted, Mobility, PassageOpen, TrafficEntered
from somrs.traffic.participant import Participant


def opened(report: int) -> PassageOpen:
    return PassageOpen(robot="Cart", fence=1, progress=0, passage="Lift1", place="Cabin", report=report)


def granted(number: int) -> Granted:
    return Granted(robot="Cart", fence=1, number=number, progress=0, way=("Bay", "Cabin"), gated=(1,))


def entered_cart() -> Participant:
    cart = Participant("Cart", "Bay")
    assert cart.entered(TrafficEntered(robot="Cart", fence=1, until=10.0, renew_within=2.0))
    return cart


def test_a_passage_that_was_open_for_a_way_that_was_given_back_is_not_open_for_the_next_way() -> None:
    cart = entered_cart()
    first_report = cart.report().number
    assert cart.granted(granted(1))
    cart.report(Mobility.BUSY)
    last_report = cart.report().number
    assert cart.granted(granted(2))
    assert not cart.opened(opened(first_report)), "it was sent before the robot gave its way back"
    assert cart.opened(opened(last_report))
    assert cart.depart() == "Cabin"


def test_a_passage_that_is_open_before_the_grant_comes_is_open() -> None:
    cart = entered_cart()
    report = cart.report().number
    assert not cart.opened(opened(report))
    assert cart.granted(granted(1))
    assert cart.may_depart
