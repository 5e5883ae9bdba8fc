"""The gateway of a site on a bus: its HTTP server passes messages on to the components that listen on the bus."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial

from somrs.protocol.messages.envelope import Message
from somrs.runtime.bus import Bus
from somrs.runtime.bus_rights import token_of_sender
from somrs.runtime.proofs import current_source
from somrs.runtime.reception import Handler, NotTaken
from somrs.runtime.wire import Unanswered


class BusParts(Mapping[str, Handler]):
    """The components of a site on the bus, as the `parts` of a gateway: each path has a handler, which passes messages on.

    They go on in the name that their sender has proven to the gateway, if it has to prove one.
    """

    def __init__(self, bus: Bus, answer_time: float) -> None:
        self._bus, self._answer_time = bus, answer_time

    def __getitem__(self, path: str) -> Handler:
        if not path.strip("/"):
            raise KeyError(path)
        return partial(self._pass_on, self._bus.address.subject(path))

    def __iter__(self) -> Iterator[str]:
        return iter(())

    def __len__(self) -> int:
        return 1

    async def _pass_on(self, subject: str, message: Message) -> Message | None:
        proof = current_source.get().proof
        try:
            return await self._bus.post_to(subject, message, self._answer_time, token_of_sender(proof()) if proof is not None else None)
        except Unanswered as error:
            raise NotTaken(str(error)) from None
