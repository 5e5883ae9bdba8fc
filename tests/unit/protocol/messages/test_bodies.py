"""The closed set of message bodies."""

from __future__ import annotations

import typing

from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.body import MessageBody


def test_whatever_is_a_body_is_one_of_the_closed_set() -> None:
    assert set(typing.get_args(Body)) == set(MessageBody.__subclasses__())
