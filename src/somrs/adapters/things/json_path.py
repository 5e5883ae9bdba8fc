"""Paths into JSON documents: `state.temperature`, `$.sensors[0].value`, `$['air quality']` (the part of RFC 9535 that names one value)."""

from __future__ import annotations

import re
from functools import lru_cache

from somrs.errors import InputError

Steps = tuple[str | int, ...]

_STEP = re.compile(r"""\.?([^\W\d][\w-]*)|\[(\d+)\]|\[(?:'([^']+)'|"([^"]+)")\]""")


@lru_cache(maxsize=4096)
def json_steps(path: str) -> Steps:
    """The keys and indexes of a path. Raises InputError."""
    rest, steps = path.removeprefix("$"), list[str | int]()
    while rest:
        match = _STEP.match(rest)
        if match is None:
            raise InputError(f"{path!r} is not a path to a value in JSON: write it as state.temperature or $.sensors[0].value")
        key, index, *quoted = match.groups()
        steps.append(int(index) if index is not None else key or quoted[0] or quoted[1])
        rest = rest[match.end() :]
    return tuple(steps)


def json_value(document: object, steps: Steps) -> object:
    """The value at the path; None if the document has none there."""
    for step in steps:
        if isinstance(document, dict) and isinstance(step, str):
            document = document.get(step)
        elif isinstance(document, list) and isinstance(step, int) and step < len(document):
            document = document[step]
        else:
            return None
    return document
