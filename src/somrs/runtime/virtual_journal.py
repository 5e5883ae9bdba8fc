"""A journal in memory, for components on virtual time. Its data have the same format as those of `storage.journal`."""

from __future__ import annotations

from itertools import chain
from typing import cast

from somrs.kernel.codec import Schema
from somrs.kernel.component import Component, Input, Stateful
from somrs.kernel.durability import JournalCodec, JournaledComponent, NumberedEffect


class VirtualJournal:
    """A journal that begins with the present component. `entries` are the encoded inputs since the last snapshot."""

    def __init__(self, component: Component, schema: Schema) -> None:
        assert hasattr(component, "state"), f"{type(component).__name__} has no state to store"
        self.journaled = JournaledComponent(cast(Stateful, component), schema)
        self.entries: list[bytes] = []
        self._written = JournalCodec(schema)
        self._followed: list[bytes] | None = None
        """What a standby has received, one batch for each input, after the state with which it began."""
        self.snapshot()

    def handle(self, event: Input, now: float) -> list[NumberedEffect]:
        """Store the input, unless it is read-only, and let the component handle it."""
        if self.journaled.schema.is_read_only(event):
            return [(effect, 0) for effect in self.journaled.component.handle(event, now)]
        entry = self.journaled.make_entry(event, now)
        self.entries.append(self._written.encode_entry(entry))
        if self._followed is not None:
            self._followed.append(JournalCodec.encode_batch(self.entries[-1:]))
        return self.journaled.handle(entry)

    def snapshot(self) -> None:
        """Store the state of the component, and drop the earlier inputs."""
        self._state = self._written.encode_snapshot(self.journaled)
        self.entries.clear()

    def add_standby(self) -> None:
        """Let a standby follow from now on."""
        self._standby_state, self._followed = self._written.encode_snapshot(self.journaled), []

    def take_over(self) -> list[object]:
        """Let the standby continue the component, with a file of its own. Return the records of what it has followed."""
        assert self._followed is not None, "no standby follows the journal"
        self.journaled = self._written.decode_snapshot(self._standby_state)
        batches = [self._written.decode_batch(batch) for batch in self._followed]
        records = self.journaled.replay(chain.from_iterable(batches))
        self.snapshot()
        self.add_standby()
        return [record.entry for record in records]

    def restart(self) -> list[object]:
        """Restore the component to its state after the last input. Return the records since the last snapshot."""
        self.journaled = self._written.decode_snapshot(self._state)
        records = self.journaled.replay(self._written.decode_batch(JournalCodec.encode_batch(self.entries)))
        return [record.entry for record in records]
