"""Filters of topics, and the subjects of NATS for them."""

from __future__ import annotations

import pytest

from somrs.errors import UsageError
from somrs.trust.identity import Identity, Role
from somrs.trust.mqtt_topics import check_topics, subjects_of


@pytest.mark.parametrize(
    ("topics", "subjects"),
    [
        ("heaters/1/state", ["heaters.1.state"]),
        ("uagv/v2/ACME/0001/#", ["uagv.v2.ACME.0001.>", "uagv.v2.ACME.0001"]),
        ("uagv/v2/+/+/state", ["uagv.v2.*.*.state"]),
        ("#", [">"]),
        ("/a//b.c/", ["/.a./.b//c./"]),  # as the server maps them: mqtt.go, mqttTopicToNATSSubject
    ],
)
def test_filters_become_subjects(topics: str, subjects: list[str]) -> None:
    check_topics(Identity(name="Thing1", roles=frozenset({Role.THING}), topics=frozenset({topics})))
    assert subjects_of(topics) == subjects


@pytest.mark.parametrize("topics", ["", "a/#/b", "a#", "a/b+", "$SYS/#", "a b", "a/*", "a/>"])
def test_what_is_no_filter_is_refused(topics: str) -> None:
    with pytest.raises(UsageError):
        check_topics(Identity(name="Thing1", roles=frozenset({Role.THING}), topics=frozenset({topics})))
