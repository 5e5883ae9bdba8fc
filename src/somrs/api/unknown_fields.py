"""Finds fields of a JSON request that the API does not know: whoever sends one expects it to have an effect."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from msgspec import Struct

from somrs.entish.parse import nearest


def unknown_fields(content: object, value: object, path: str = "") -> Iterator[str]:
    """A text for each field of the JSON `content` that the Struct which was read from it, or a Struct in it, does not have."""
    if isinstance(value, Struct) and isinstance(content, Mapping):
        config, fields = value.__struct_config__, dict(zip(value.__struct_encode_fields__, value.__struct_fields__, strict=True))
        for name, part in content.items():
            if name in fields:
                yield from unknown_fields(part, getattr(value, fields[name]), f"{path}.{name}")
            elif name != config.tag_field:
                hint = nearest(name, fields) or f"there are {', '.join(fields)}"
                yield f"there is no field {f'{path}.{name}'.removeprefix('.')}; {hint}"
    elif isinstance(value, Mapping) and isinstance(content, Mapping):
        for name, part in content.items():
            yield from unknown_fields(part, value.get(name), f"{path}.{name}")
    elif isinstance(value, Sequence) and isinstance(content, Sequence) and not isinstance(content, str):
        for number, (part, item) in enumerate(zip(content, value, strict=False)):
            yield from unknown_fields(part, item, f"{path}[{number}]")
