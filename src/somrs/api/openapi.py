"""The OpenAPI 3.1 document of the operations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec

from somrs import __version__
from somrs.client.operations import Document, Operation, Parameter
from somrs.client.refusals import REFUSALS, ErrorReport

_REFERENCE = "#/components/schemas/{name}"


def document(operations: Sequence[Operation]) -> dict[str, Any]:
    """The document, as JSON values."""
    types = [one.returns for one in operations if one.returns not in (None, type(None), Document)]
    types += [parameter.type for one in operations for parameter in one.parameters]
    schemas, components = msgspec.json.schema_components([*types, ErrorReport], ref_template=_REFERENCE)
    by_type = dict(zip(map(repr, [*types, ErrorReport]), schemas, strict=True))
    paths: dict[str, Any] = {}
    for one in operations:
        paths.setdefault(one.path, {})[one.method.lower()] = _described(one, by_type)
    return {
        "openapi": "3.1.0",
        "info": {"title": "SO-MRS", "version": __version__, "description": "State wishes about a building, and see them come true."},
        "servers": [{"url": "/api"}],
        "paths": paths,
        "components": {"schemas": components},
    }


def _described(one: Operation, schemas: dict[str, Any]) -> dict[str, Any]:
    summary, _, rest = one.doc.partition("\n")
    found: dict[str, Any] = {"operationId": one.name, "tags": [one.group], "summary": summary, "responses": _responses(one, schemas)}
    if rest.strip():
        found["description"] = rest.strip()
    if plain := [_parameter(parameter, schemas) for parameter in one.parameters if parameter.place != "body"]:
        found["parameters"] = plain
    for parameter in one.parameters:
        if parameter.place == "body":
            content = {"application/json": {"schema": schemas[repr(parameter.type)]}}
            found["requestBody"] = {"required": parameter.required, "content": content}
    return found


def _parameter(parameter: Parameter, schemas: dict[str, Any]) -> dict[str, Any]:
    return {"name": parameter.name, "in": parameter.place, "required": parameter.required, "schema": schemas[repr(parameter.type)]}


def _responses(one: Operation, schemas: dict[str, Any]) -> dict[str, Any]:
    if one.returns is Document:
        good: dict[str, Any] = {"description": "The file", "content": {"application/octet-stream": {}}}
    elif one.returns in (None, type(None)):
        good = {"description": "Done"}
    else:
        good = {"description": "The answer", "content": {"application/json": {"schema": schemas[repr(one.returns)]}}}
    trouble = {"application/json": {"schema": schemas[repr(ErrorReport)]}}
    return {"200": good, **{str(code): {"description": text, "content": trouble} for code, text in REFUSALS.items()}}
