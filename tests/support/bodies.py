"""Hypothesis strategies for messages with every kind of body, made from the annotations of the Structs."""

from __future__ import annotations

import typing
from enum import Enum
from functools import cache
from typing import Any, Literal

from hypothesis import strategies as st
from msgspec import Struct

from somrs.protocol.messages import frp
from somrs.protocol.messages.bodies import Body, FrpBody
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message
from somrs.protocol.soap.xml import MOST_WHOLE, union_of

KINDS: tuple[type[Struct], ...] = union_of(Body)

_SURROGATES: tuple[Literal["Cs"]] = ("Cs",)
_CONTROLS = "".join(chr(code) for code in range(32) if chr(code) not in "\t\n\r") + "\ufffe\uffff"
texts = st.text(st.characters(exclude_categories=_SURROGATES, exclude_characters=_CONTROLS), max_size=6) | st.sampled_from(
    ["", " ", " a ", "\r", "a\r\nb", "\n\t", "<a>&amp;]]>", "ąę 日本 \U0001f916", "true", "1", "\u0085\u2028"]
)
names = st.text("abcXYZ019.#-_", min_size=1, max_size=12)
ids = st.uuids().map(lambda uuid: uuid.urn)
addresses = names.map(lambda name: f"http://127.0.0.1:8080/{name}?a=1&b=2".replace("#", "/"))

_SIMPLE: dict[Any, st.SearchStrategy[Any]] = {
    str: texts,
    float: st.floats(allow_nan=False),
    int: st.integers(-MOST_WHOLE, MOST_WHOLE),
    bool: st.booleans(),
    type(None): st.none(),
}


@cache
def values_of(hint: Any) -> st.SearchStrategy[Any]:
    """A strategy for values of the annotated type."""
    if hint in _SIMPLE:
        return _SIMPLE[hint]
    members = union_of(hint)
    if len(members) > 1:
        return st.one_of([values_of(member) for member in members])
    if typing.get_origin(hint) is tuple:
        return st.lists(values_of(typing.get_args(hint)[0]), max_size=2).map(tuple)
    if typing.get_origin(hint) is dict:
        return st.dictionaries(texts, values_of(typing.get_args(hint)[1]), max_size=2)
    if issubclass(hint, Enum):
        return st.sampled_from(hint)
    if hint is frp.Fault:
        codes = ["env:Sender", "env:Receiver", "env:MustUnderstand", "wsa:ActionNotSupported", "frp:NotAllowed"]
        return st.builds(frp.Fault, code=st.sampled_from(codes), text=texts)
    hints = typing.get_type_hints(hint)
    return st.builds(hint, **{name: values_of(hints[name]) for name in hint.__struct_fields__})


@cache
def messages(kind: type[Struct]) -> st.SearchStrategy[Message]:
    """A strategy for messages with a body of this kind. Messages of the Failure Recovery Protocol have a transaction."""
    session = {"transaction": ids, "participant": names} if kind in union_of(FrpBody) else {}
    header = st.builds(
        Header,
        sender=st.just(ANONYMOUS) | addresses,
        recipient=addresses,
        message_id=ids,
        relates_to=st.none() | ids,
        reply_to=st.just(ANONYMOUS) | addresses,
        **session,
    )
    return st.tuples(header, values_of(kind)).map(lambda pair: Message(header=pair[0], body=pair[1]))
