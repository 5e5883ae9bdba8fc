"""Names of things that announce or describe themselves: each means the same thing as long as there is a system."""

from __future__ import annotations

import json
from pathlib import Path

from somrs.adapters.things.home_assistant import Discovery
from somrs.adapters.things.thing_names import ThingNames


def lamps(names: ThingNames, *topics: str) -> dict[str | None, str]:
    """The names of lamps that are all called Lamp, by the topics to which they listen, if they announce themselves one after the other."""
    discovery = Discovery("house", names=names)
    for topic in topics:
        message = {"name": "Lamp", "unique_id": topic, "command_topic": topic}
        discovery.received(f"homeassistant/light/{topic}/config", json.dumps(message).encode())
        discovery.things()
    return {thing.entry.services["SwitchOn"].write[0].topic: thing.name for thing in discovery.things()}


def test_things_of_one_name_keep_their_names_when_they_are_announced_in_another_order_after_a_restart(tmp_path: Path) -> None:
    file = tmp_path / "things" / "Gateway.json"
    names = lamps(ThingNames(file), "zz", "aa")
    assert names == {"zz": "Lamp", "aa": "Lamp2"}
    assert lamps(ThingNames(file), "aa", "zz") == names
    assert lamps(ThingNames(file), "aa") == {"aa": "Lamp2"}


def test_things_of_one_name_at_two_brokers_are_two_things() -> None:
    names = ThingNames()
    assert [names.name("one/lamp", "Lamp"), names.name("other/lamp", "Lamp")] == ["Lamp", "Lamp2"]


def test_names_that_cannot_be_stored_or_read_are_given_all_the_same(tmp_path: Path) -> None:
    (tmp_path / "damaged.json").write_text("[1")
    assert ThingNames(tmp_path / "damaged.json").name("x", "Lamp") == "Lamp"
    (tmp_path / "file").write_text("")
    assert ThingNames(tmp_path / "file" / "names.json").name("x", "Lamp") == "Lamp"
