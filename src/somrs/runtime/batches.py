"""Several messages in one request, between nodes of SO-MRS that have told each other that they take that: an extension of ours.

A batch is an array of msgpack with the messages, each a SOAP document as it would be alone; it is answered with an array that says
of each, in this order, what the answer to it alone would have said. Other stacks are never sent one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Annotated

import msgspec

from somrs.protocol.soap import soap
from somrs.protocol.soap.document import MOST_BYTES

MEDIA_TYPE = "application/vnd.so-mrs.batch+msgpack"

ACCEPTED = f"{soap.MEDIA_TYPE}, {MEDIA_TYPE}"
"""What every answer of a server says in its header `Accept-Post` (Linked Data Platform 1.0, 7.1)."""

MAX_BATCH_SIZE = 64
"""The most messages of a batch: the loop of whoever takes it does nothing else while it handles them."""

Outcome = tuple[int, bytes]
"""What came of one message: the status of HTTP, and what was said with it."""

_OVERHEAD = 8
"""Bytes that msgpack needs around a document at most."""

_BATCH = msgspec.msgpack.Decoder(Annotated[list[bytes], msgspec.Meta(max_length=MAX_BATCH_SIZE)])
_OUTCOMES = msgspec.msgpack.Decoder(list[Outcome])


def fit_batch(documents: Iterable[bytes]) -> Iterator[bytes]:
    """The first of the documents, as many as one batch holds: together they are as large at most as one alone may be."""
    free_bytes = MOST_BYTES - _OVERHEAD
    for number, document in enumerate(documents):
        free_bytes -= len(document) + _OVERHEAD
        if number and (free_bytes < 0 or number == MAX_BATCH_SIZE):
            return
        yield document


def batch(documents: list[bytes]) -> bytes:
    return msgspec.msgpack.encode(documents)


def documents_of(batch: bytes) -> list[bytes]:
    """The documents in a batch. Raises ValueError for what is none."""
    documents: list[bytes] = _BATCH.decode(batch)
    return documents


def answer(outcomes: list[Outcome]) -> bytes:
    return msgspec.msgpack.encode(outcomes)


def outcomes_of(answer: bytes) -> list[Outcome]:
    """What came of each message of a batch. Raises ValueError for what does not say that."""
    return _OUTCOMES.decode(answer)
