"""The OpenAPI 3.1 document of the operations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec

from somrs.client.operations import Document, Operation, Parameter
from somrs.client.refusals import REFUSALS, ErrorReport
from somrs.version import __version__

_REFERENCE = "#/components/schemas/{name}"


def document(operations: Sequence[Operation]) -> dict[str, Any]:
    """The OpenAPI document of the operations, as JSON values."""
    types = [operation.returns for operation in operations if operation.returns not in (None, type(None), Document)]
    types += [parameter.type for operation in operations for parameter in operation.parameters]
    schemas, components = msgspec.json.schema_components([*types, ErrorReport], ref_template=_REFERENCE)
    by_type = dict(zip(map(repr, [*types, ErrorReport]), schemas, strict=True))
    paths: dict[str, Any] = {}
    for operation in operations:
        paths.setdefault(operation.path, {})[operation.method.lower()] = _describe(operation, by_type)
    return {
        "openapi": "3.1.0",
        "info": {"title": "SO-MRS", "version": __version__, "description": "Submit tasks as goals, and operate a site."},
        "servers": [{"url": "/api"}],
        "paths": paths,
        "components": {"schemas": components},
    }


def _describe(operation: Operation, schemas: dict[str, Any]) -> dict[str, Any]:
    summary, _, rest = operation.doc.partition("\n")
    description: dict[str, Any] = {
        "operationId": operation.name,
        "tags": [operation.group],
        "summary": summary,
        "description": "\n\n".join(filter(None, (rest.strip(), f"Needs the right `{operation.required_right}`."))),
        "responses": _responses(operation, schemas),
    }
    if plain := [_parameter(parameter, schemas) for parameter in operation.parameters if parameter.place != "body"]:
        description["parameters"] = plain
    for parameter in operation.parameters:
        if parameter.place == "body":
            content = {"application/json": {"schema": schemas[repr(parameter.type)]}}
            description["requestBody"] = {"required": parameter.required, "content": content}
    return description


def _parameter(parameter: Parameter, schemas: dict[str, Any]) -> dict[str, Any]:
    return {"name": parameter.name, "in": parameter.place, "required": parameter.required, "schema": schemas[repr(parameter.type)]}


def _responses(operation: Operation, schemas: dict[str, Any]) -> dict[str, Any]:
    if operation.returns is Document:
        good: dict[str, Any] = {"description": "The file", "content": {"application/octet-stream": {}}}
    elif operation.returns in (None, type(None)):
        good = {"description": "Done"}
    else:
        good = {"description": "The result", "content": {"application/json": {"schema": schemas[repr(operation.returns)]}}}
    error_content = {"application/json": {"schema": schemas[repr(ErrorReport)]}}
    return {"200": good, **{str(code): {"description": text, "content": error_content} for code, text in REFUSALS.items()}}
