"""A journal without a disk, for components on virtual time. It is written and read as `storage.journal` does."""

from __future__ import annotations

from typing import cast

from somrs.kernel.codec import Schema
from somrs.kernel.component import Component, Input, Stateful
from somrs.kernel.durability import JournalCodec, JournaledComponent, NumberedEffect


class VirtualJournal:
    """Begins with the component as it is. `entries` are its inputs since the last snapshot, as they are written."""

    def __init__(self, component: Component, schema: Schema) -> None:
        assert hasattr(component, "state"), f"{type(component).__name__} has no state that could be kept"
        self.journaled = JournaledComponent(cast(Stateful, component), schema)
        self.entries: list[bytes] = []
        self._written = JournalCodec(schema)
        self.snapshot()

    def handle(self, event: Input, now: float) -> list[NumberedEffect]:
        """Keep the input, if that has to be, and have the component handle it."""
        if self.journaled.schema.is_read_only(event):
            return [(effect, 0) for effect in self.journaled.component.handle(event, now)]
        entry = self.journaled.make_entry(event, now)
        self.entries.append(self._written.encode_entry(entry))
        return self.journaled.handle(entry)

    def snapshot(self) -> None:
        """Begin anew with the component as it is now."""
        self._state = self._written.encode_snapshot(self.journaled)
        self.entries.clear()

    def restart(self) -> list[object]:
        """Have the component as it was when its last input came. What it recorded since the last snapshot."""
        self.journaled = self._written.decode_snapshot(self._state)
        records = self.journaled.replay(self._written.decode_batch(JournalCodec.encode_batch(self.entries)))
        return [record.entry for record in records]
