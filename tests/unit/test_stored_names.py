"""The names of Structs and fields in journals and messages, where they differ from the names in the code, are those of the table.

To write the table anew: `python -m tests.unit.test_stored_names`.
"""

from __future__ import annotations

import json
import pkgutil
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module

import pytest
from msgspec import Struct

import somrs
from tests.support.paths import ROOT

TABLE = ROOT / "tests" / "data" / "stored-names.json"
ADVICE = """These names are in journals, messages or requests to the API.
Keep a stored name: write `name=` for the field, or `tag=` for the Struct (docs/decisions/0027-names.md).
If a stored name has to change: a Struct in a journal needs a migration (docs/reference/journal.md), and a Struct that programs exchange
needs a new version of the wire, because programs of other versions send the old name.
If no stored name has changed, but one was added, or a class or field was moved or renamed in the code, write the table anew:
python -m tests.unit.test_stored_names"""


def structs() -> Iterator[type[Struct]]:
    """The Structs of all modules, except of modules whose libraries are not installed."""
    for info in pkgutil.walk_packages(somrs.__path__, "somrs."):
        with suppress(ModuleNotFoundError):
            for value in vars(import_module(info.name)).values():
                if isinstance(value, type) and issubclass(value, Struct) and value.__module__ == info.name:
                    yield value


def stored_names() -> dict[str, str]:
    """The tags of Structs, the fields of tags and the names of fields, without those that are equal to the name in the code."""
    names: dict[str, str] = {}
    for struct in structs():
        place = f"{struct.__module__}.{struct.__qualname__}".removeprefix("somrs.")
        tag, tag_field = struct.__struct_config__.tag, struct.__struct_config__.tag_field
        if tag is not None and tag != struct.__name__:
            names[place] = str(tag)
        if tag_field not in (None, "type"):
            names[f"{place}, field of the tag"] = str(tag_field)
        fields = zip(struct.__struct_fields__, struct.__struct_encode_fields__, strict=True)
        names |= {f"{place}.{field}": stored for field, stored in fields if field != stored}
    return dict(sorted(names.items()))


def test_stored_names_stay_as_they_are() -> None:
    pytest.importorskip("nicegui", reason="the windows' libraries are not installed")
    actual_names, pinned_names = stored_names(), json.loads(TABLE.read_text("utf-8"))
    changes = [
        f"{place}: {pinned_names.get(place, 'none')} in {TABLE.name}, {actual_names.get(place, 'none')} in the code"
        for place in sorted(actual_names.keys() | pinned_names.keys())
        if actual_names.get(place) != pinned_names.get(place)
    ]
    assert not changes, "\n".join([*changes, ADVICE])


if __name__ == "__main__":
    TABLE.write_text(json.dumps(stored_names(), indent=2) + "\n", "utf-8")
