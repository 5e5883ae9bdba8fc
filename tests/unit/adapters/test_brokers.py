"""The addresses of brokers: one server, or several."""

from __future__ import annotations

import pytest

from somrs.adapters.brokers import ServerChoice, read_broker_url


def test_a_broker_has_one_server_or_several() -> None:
    assert read_broker_url("mqtt://one").servers == (("one", 1883),)
    broker = read_broker_url("mqtts://fleet@one,mqtts://fleet@[::1]:8884")
    assert (broker.scheme, broker.user, broker.servers) == ("mqtts", "fleet", (("one", 8883), ("::1", 8884)))


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("http://one", "is no address"),
        ("mqtt://one,", "is no address"),
        ("mqtt://one/path", "is no address"),
        ("mqtt://one:99999", "no valid port"),
        ("mqtt://one,mqtts://two", "different schemes"),
        ("mqtt://anna@one,mqtt://two", "different schemes or users"),
    ],
)
def test_what_is_no_broker_is_refused(text: str, problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        read_broker_url(text)


def test_the_next_server_is_used_when_one_is_lost() -> None:
    choice = ServerChoice([("one", 1), ("two", 2)])
    used = [choice.current]
    for _ in range(2):
        choice.lost()
        used.append(choice.current)
    assert used == [("one", 1), ("two", 2), ("one", 1)]
