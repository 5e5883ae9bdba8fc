"""Messages on the bus that are almost right, or not at all, drawn by a seed.

On a bus without certificates, anybody may do everything, so what would be a deletion or a forged entry of a journal is left out there: what
is drawn may be refused or ignored, and does no harm.
"""

from __future__ import annotations

import asyncio
import json
import random
from collections.abc import Awaitable, Callable
from typing import Any
from urllib.parse import urlsplit

import msgspec

from somrs.protocol.messages import directory, frp
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message
from somrs.runtime.batches import batch, outcomes_of
from somrs.runtime.bus_format import encode
from verification.attack.bus_target import Attacker, BusTarget
from verification.attack.fuzz import BODIES, TEXTS
from verification.attack.target import PATIENCE, expect

PATHS = {"Repository": "repository", "Registry": "registry", "Task Manager": "task-manager"}
NAMES = ("repository", "registry", "task-manager", "scheduler", "gateway", "api", "Robot1", "Intruder1", "%2E", "*", "")
LARGEST = 1_000_000
"""Bytes of the largest payload; the servers take 1 MiB."""

VALUES: tuple[object, ...] = (
    *TEXTS,
    *(-1, 0, 2**63 - 1, -(2**63), 2**64 - 1, 1e308, float("inf"), float("nan"), -0.0, None, True),
    *(b"\x00" * 9, [], {}, [[]], {"": None}, {"a": [1]}, [None] * 1000, msgspec.msgpack.Ext(5, b"x")),
)
NONSENSE = (
    *(b"", b"\xc1", b"\xc0", b"\x90", b"\x80", b"{}", b"<a/>", b"\x00" * 1000),
    *(
        b"\x91" * 100_000,
        b"\x81\xa1a" * 100_000,
        b"\xdd\xff\xff\xff\xff",
        b"\xc6\xff\xff\xff\xffx",
        b"\xdf\xff\xff\xff\xff",
        b"x" * LARGEST,
    ),
)
SUBJECTS = (
    *("somrs.{site}.{name}", "somrs.elsewhere.{name}", "somrs-from.{site}.{name}.{name}", "somrs-from.{site}.{me}.devices.{name}"),
    *(
        "somrs-from.{site}.{me}",
        "somrs-from.{site}.{me}.{name}.x.y.z",
        "somrs-from.elsewhere.{me}.{name}",
        "somrs-beginnings.{site}.{name}",
    ),
    *("somrs.{site}.processes.{name}.0", "somrs-from.{site}.{me}.processes.{name}.0", "somrs-from.{site}.{me}.answers.{name}.0.1"),
    *("somrs-resignation.{site}.{name}", "somrs-status.{site}", "_INBOX.{name}.0.1", "somrs-stores.{site}.{name}.x"),
)
FOREIGN_SUBJECTS = (
    *("somrs-journal.{site}.{name}", "somrs-copy.{site}.{name}.info", "$KV.somrs-leaders.{site}.{name}", "$KV.somrs-sites.{site}"),
    *("somrs-stores.{site}.{name}", "somrs-stores.{site}", "$SYS.REQ.SERVER.PING", "$SRV.PING"),
)
"""What nobody of a low role may publish."""
REPLIES = (
    *("", "somrs.{site}.repository", "somrs-from.{site}.gateway.repository", "_INBOX.{name}.0.1", "_INBOX.", "$JS.API.STREAM.LIST"),
    *("somrs-journal.{site}.{name}", "somrs-from.{site}.{me}.task-manager"),
)
PATTERNS = (
    *(">", "*.>", "somrs-from.>", "somrs-from.{site}.*.repository", "somrs-from.*.*.answers.>", "somrs-from.{site}.*.devices.Robot1"),
    *("somrs.>", "_INBOX.>", "_INBOX.{name}.>", "$JS.>", "$KV.>", "somrs-journal.>", "somrs-copy.>", "somrs-stores.>", "$SYS.>"),
)
REQUESTS = (
    *(
        "INFO",
        "STREAM.LIST",
        "STREAM.NAMES",
        "STREAM.INFO.{stream}",
        "STREAM.MSG.GET.{stream}",
        "DIRECT.GET.{stream}",
        "CONSUMER.LIST.{stream}",
    ),
    *("CONSUMER.INFO.{stream}.x", "CONSUMER.MSG.NEXT.{stream}.x", "CONSUMER.CREATE.{stream}", "DIRECT.GET.{stream}.$KV.somrs-sites.x"),
)
FOREIGN_REQUESTS = (
    *("STREAM.CREATE.{stream}", "STREAM.UPDATE.{stream}", "STREAM.DELETE.{stream}", "STREAM.PURGE.{stream}", "STREAM.MSG.DELETE.{stream}"),
    *("STREAM.SNAPSHOT.{stream}", "STREAM.RESTORE.{stream}", "STREAM.LEADER.STEPDOWN.{stream}", "META.LEADER.STEPDOWN", "SERVER.REMOVE"),
    *("CONSUMER.DELETE.{stream}.x", "CONSUMER.DURABLE.CREATE.{stream}.x", "ACCOUNT.PURGE.$G"),
)
STREAMS = ("KV_somrs-sites", "KV_somrs-leaders", "somrs-journal-{site}-{name}", "somrs-copy-{site}-{name}", "mine", "")
STREAM_SETTINGS: tuple[dict[str, object], ...] = (
    {},
    {"name": "mine", "subjects": ["somrs-from.>"], "republish": {"src": ">", "dest": "somrs-from.scenario-1.gateway.repository"}},
    {"name": "mine", "sources": [{"name": "somrs-journal-scenario-1-repository"}]},
    {"stream_name": "KV_somrs-sites", "config": {"deliver_subject": "somrs-from.scenario-1.gateway.repository"}},
    {"seq": 1},
    {"seq": -1, "last_by_subj": ">"},
    {"filter": ">", "keep": 0},
)
STRANGE_LINES = (
    *(
        b"CONNECT {}\r\nPING\r\n",
        b"PUB somrs.x 99999999999\r\nx\r\n",
        b"SUB > 1\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00",
        b"GET / HTTP/1.1\r\n\r\n",
    ),
    *(b'CONNECT {"verbose":true,"user":"somrs:role:bus","pass":"x"}\r\n', b"\x00" * 5000, b"INFO {}\r\n", b"x" * 70_000),
)


class BusFuzz:
    """Draws what attackers do. `seed` and the number of one say which it is."""

    def __init__(self, target: BusTarget, seed: int) -> None:
        self._target, self._random = target, random.Random(seed)

    async def draw(self) -> None:
        """Do one thing."""
        [act] = self._random.choices([*_ACTS], [*_ACTS.values()])
        await act(self, self._random.choice(self._target.attackers))

    async def message(self, attacker: Attacker) -> None:
        """Send a batch of messages that have been changed a little to a component, which answers each."""
        component = self._random.choice([*PATHS])
        documents = [self._document(component) for _ in range(self._random.choice((1, 1, 1, 2, 5, 64)))]
        answer = await attacker.ask(attacker.subject(PATHS[component]), batch(documents))
        expect(answer, f"nobody is the {component}")
        for status, body in outcomes_of(answer):
            text = body.decode(errors="replace")
            expect(status in (200, 202, 400, 403, 404, 413, 500, 503), f"{component}: {documents[0][-600:]!r} gets {status}")
            expect("internal error" not in text, f"{component}: {documents!r:.1500} is an internal error: {text[:300]}")

    def _document(self, component: str) -> bytes:
        recipient = f"{self._target.bus.gateway}/{PATHS[component]}"
        header = Header(sender=ANONYMOUS, recipient=recipient, message_id=f"urn:uuid:{self._random.getrandbits(64)}")
        body = self._random.choice(BODIES[component])
        if isinstance(body, frp.Completed | frp.Progress):
            header = msgspec.structs.replace(header, transaction="urn:uuid:1", participant="Robot1#1")
        elif self._random.random() < 0.1:
            sender = f"{self._target.bus.gateway}/devices/Robot1"
            header, body = msgspec.structs.replace(header, sender=sender), directory.Retract(provider="Robot9")
        document = encode(Message(header=header, body=body))
        for _ in range(self._random.randint(0, 3)):
            document = self._random.choice((self._flipped, self._cut, self._replaced, self._replaced))(document)
        return document

    def _flipped(self, document: bytes) -> bytes:
        place = self._random.randrange(len(document) or 1)
        return document[:place] + self._random.randbytes(1) + document[place + 1 :]

    def _cut(self, document: bytes) -> bytes:
        return document[: self._random.randrange(len(document) or 1)]

    def _replaced(self, document: bytes) -> bytes:
        """Put another value, or none, in a place of it."""
        try:
            tree: object = msgspec.msgpack.decode(document)
        except (ValueError, RecursionError):
            return document
        places = [*_places(tree)]
        if not places:
            return document
        container, key = self._random.choice(places)
        if self._random.random() < 0.3:
            del container[key]
        else:
            container[key] = self._random.choice(VALUES)
        return msgspec.msgpack.encode(tree)

    async def nonsense(self, attacker: Attacker) -> None:
        """Send what is no batch to a component, which says so."""
        payload = self._random.choice((*NONSENSE, self._random.randbytes(self._random.randrange(3000)), self._wrong_batch()))
        await attacker.ask(attacker.subject(self._random.choice([*PATHS.values()])), payload)

    def _wrong_batch(self) -> bytes:
        counted = [self._document("Repository")] * self._random.choice((0, 1, 65, 1000))
        return msgspec.msgpack.encode(
            self._random.choice((counted, [1, 2], [[b"x"]], {"a": b"x"}, [*counted, None], ["x"], [*counted, b""]))
        )

    async def wrong_subject(self, attacker: Attacker) -> None:
        """Publish where nobody, or somebody else, is meant, also with a subject for answers that is somebody else's."""
        subjects = (*SUBJECTS, *FOREIGN_SUBJECTS) if attacker.token is not None else SUBJECTS
        subject = self._filled(attacker, self._random.choice(subjects))
        reply = self._filled(attacker, self._random.choice(REPLIES))
        if _is_publishable(subject) and (not reply or _is_publishable(reply)):
            await attacker.publish(subject, self._random.choice((batch([self._document("Repository")]), *NONSENSE[:8])), reply)

    async def wrong_reply(self, attacker: Attacker) -> None:
        """Have a component answer where somebody else listens."""
        component = self._random.choice([*PATHS])
        reply = self._filled(attacker, self._random.choice(REPLIES))
        if not reply or _is_publishable(reply):
            await attacker.publish(attacker.subject(PATHS[component]), batch([self._document(component)]), reply)

    async def listen(self, attacker: Attacker) -> None:
        """Listen to what is for others."""
        pattern = self._filled(attacker, self._random.choice(PATTERNS))
        if ".." not in pattern:
            await attacker.overhear(pattern)

    async def jetstream(self, attacker: Attacker) -> None:
        """Ask JetStream for what others have stored, to change it, or to publish in their names."""
        requests = (*REQUESTS, *FOREIGN_REQUESTS) if attacker.token is not None else REQUESTS
        stream = self._filled(attacker, self._random.choice(STREAMS))
        subject = f"$JS.API.{self._random.choice(requests)}".replace("{stream}", stream)
        payload = self._random.choice((*map(_json, STREAM_SETTINGS[1 if attacker.token is None else 0 :]), b"{", b"\xff", b"[]"))
        if attacker.token is None and "CONSUMER.CREATE" in subject:
            payload = b"{}"
        reply = self._filled(attacker, self._random.choice(REPLIES))
        if _is_publishable(subject) and (not reply or _is_publishable(reply)):
            await attacker.publish(subject, payload, reply)

    async def stranger(self, attacker: Attacker) -> None:
        """Connect without a certificate, and send what is no NATS."""
        parts = urlsplit(attacker.bus.servers)
        async with asyncio.timeout(PATIENCE):
            _, writer = await asyncio.open_connection(parts.hostname, parts.port)
            writer.write(self._random.choice((*STRANGE_LINES, self._random.randbytes(200))))
        writer.close()

    def _filled(self, attacker: Attacker, text: str) -> str:
        return (
            text.replace("{site}", attacker.bus.site).replace("{me}", attacker.token or "x").replace("{name}", self._random.choice(NAMES))
        )


_ACTS: dict[Callable[[BusFuzz, Attacker], Awaitable[None]], int] = {
    BusFuzz.message: 50,
    BusFuzz.nonsense: 10,
    BusFuzz.wrong_subject: 12,
    BusFuzz.wrong_reply: 8,
    BusFuzz.listen: 6,
    BusFuzz.jetstream: 12,
    BusFuzz.stranger: 2,
}
"""What is drawn, and how often."""


def _places(tree: object) -> list[tuple[Any, Any]]:
    """All places in decoded msgpack: the map or the array, and the key."""
    places: list[tuple[Any, Any]] = []
    entries = [*tree.items()] if isinstance(tree, dict) else [*enumerate(tree)] if isinstance(tree, list) else []
    for key, entry in entries:
        places += [(tree, key), *_places(entry)]
    return places


def _is_publishable(subject: str) -> bool:
    """Whether the servers would take it as a subject: wrong ones end the connection."""
    return all(token and token not in ("*", ">") for token in subject.split("."))


def _json(value: object) -> bytes:
    return json.dumps(value).encode()
