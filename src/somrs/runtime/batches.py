"""Several messages in one HTTP request: an extension of SO-MRS, used only between nodes that announce it.

A batch is a msgpack array of SOAP documents. The response is an array with the outcome of each document, in the same order: what the
response to it alone would have been. Other stacks never receive a batch.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Annotated

import msgspec

from somrs.protocol.soap import soap
from somrs.protocol.soap.document import MOST_BYTES

MEDIA_TYPE = "application/vnd.so-mrs.batch+msgpack"

ACCEPTED = f"{soap.MEDIA_TYPE}, {MEDIA_TYPE}"
"""The header `Accept-Post` of every response of a server (Linked Data Platform 1.0, 7.1)."""

MAX_BATCH_SIZE = 64
"""The maximal number of messages in a batch: the recipient's event loop does nothing else while it handles them."""

Outcome = tuple[int, bytes]
"""The outcome of one message: the HTTP status and the body."""

_OVERHEAD = 8
"""The maximal overhead of msgpack for each document, in bytes."""

_BATCH = msgspec.msgpack.Decoder(Annotated[list[bytes], msgspec.Meta(max_length=MAX_BATCH_SIZE)])
_OUTCOMES = msgspec.msgpack.Decoder(list[Outcome])


def fit_batch(documents: Iterable[bytes]) -> Iterator[bytes]:
    """Yield the first documents, as many as one batch holds: together at most as large as one document may be."""
    free_bytes = MOST_BYTES - _OVERHEAD
    for number, document in enumerate(documents):
        free_bytes -= len(document) + _OVERHEAD
        if number and (free_bytes < 0 or number == MAX_BATCH_SIZE):
            return
        yield document


def batch(documents: list[bytes]) -> bytes:
    return msgspec.msgpack.encode(documents)


def documents_of(batch: bytes) -> list[bytes]:
    """Return the documents in a batch. Raises ValueError for invalid data."""
    documents: list[bytes] = _BATCH.decode(batch)
    return documents


def answer(outcomes: list[Outcome]) -> bytes:
    return msgspec.msgpack.encode(outcomes)


def outcomes_of(answer: bytes) -> list[Outcome]:
    """Return the outcomes of the messages of a batch. Raises ValueError for invalid data."""
    return _OUTCOMES.decode(answer)
