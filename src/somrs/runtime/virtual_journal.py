"""A journal in memory, for components on virtual time. Its data have the same format as those of `storage.journal`."""

from __future__ import annotations

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
        self.snapshot()

    def handle(self, event: Input, now: float) -> list[NumberedEffect]:
        """Store the input, unless it is read-only, and let the component handle it."""
        if self.journaled.schema.is_read_only(event):
            return [(effect, 0) for effect in self.journaled.component.handle(event, now)]
        entry = self.journaled.make_entry(event, now)
        self.entries.append(self._written.encode_entry(entry))
        return self.journaled.handle(entry)

    def snapshot(self) -> None:
        """Store the state of the component, and drop the earlier inputs."""
        self._state = self._written.encode_snapshot(self.journaled)
        self.entries.clear()

    def restart(self) -> list[object]:
        """Restore the component to its state after the last input. Return the records since the last snapshot."""
        self.journaled = self._written.decode_snapshot(self._state)
        records = self.journaled.replay(self._written.decode_batch(JournalCodec.encode_batch(self.entries)))
        return [record.entry for record in records]
