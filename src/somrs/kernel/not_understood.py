"""The answer to a request that is not for the component that has received it: its sender must not wait for one that never comes."""

from __future__ import annotations

from somrs.kernel.component import Effects, Send
from somrs.protocol.messages.bodies import REQUESTS
from somrs.protocol.messages.envelope import Message, reply
from somrs.protocol.messages.frp import Fault


def refuse_request(message: Message, purpose: str) -> Effects:
    """Refuse the message if it is a request. `purpose`: what the component is, and does."""
    if type(message.body) in REQUESTS:
        text = f"{type(message.body).__name__} is not understood here: {purpose}"
        yield Send(reply(message, Fault(code="wsa:ActionNotSupported", text=text), message.header.recipient))
