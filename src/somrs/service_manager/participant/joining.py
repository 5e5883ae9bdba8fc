"""How a device joins the system and stays in it: its definitions and its object go to the Repository, its offers to the
Service Registry, under a lease that is renewed. Steps that get no answer are taken again.
"""

from __future__ import annotations

from enum import Enum

from somrs.entish.parse import nearest
from somrs.kernel.component import Ask, Effect, Send, Wake
from somrs.ontology.objects import Object, ObjectAdded
from somrs.ontology.services import ServiceType
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.directory import AT_ONCE, Offer, Publish, Published, Renew, Retract
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import (
    Define,
    Defined,
    MapPage,
    OntologyPage,
    ReadMap,
    ReadOntology,
    Rejected,
    Updated,
    UpdateMap,
    by_kind,
)
from somrs.service_manager.sdk.device import before
from somrs.service_manager.sdk.orders import Capability, Profile, Report

TIMER = "joining"
TELLING = 60.0
"""Seconds for which the Repository is told what a service left; later than that, others may know better."""

PATIENCE = 5.0
"""Seconds after which a request without an answer is made anew."""


class _Step(Enum):
    """What comes next; in this order."""

    DEFINE = "bring new definitions"
    READ = "find the service types that are known by name only"
    LOOK = "look whether the device is on the map"
    ADD = "put it there"
    PUBLISH = "offer the services"
    RENEW = "renew the lease"
    LEFT = "it has left"


class Joining:
    """Owned by a ServiceManager, which hands it the answers of Repository and Registry, and its timer."""

    def __init__(self, profile: Profile, repository: str, registry: str) -> None:
        self._profile, self._repository, self._registry = profile, repository, registry
        self._address = ""
        self._incarnation = 0.0
        self._asked = self._told = 0
        self._waits_for = ""
        self._after = 0
        self._types: dict[str, ServiceType] = {c.type_name: c.type for c in profile.capabilities if isinstance(c.type, ServiceType)}
        self._seen: set[str] = set()
        self._object_type = profile.type
        self._step = _Step.DEFINE
        self.joined = False

    def start(self, address: str, now: float) -> list[Effect]:
        self._address, self._incarnation = address, now
        return self._go(_Step.DEFINE if self._profile.definitions else _Step.READ, now)

    def leave(self, now: float) -> list[Effect]:
        self._step = _Step.LEFT
        return [Wake(TIMER, None), self._ask(self._registry, Retract(provider=self._profile.name), now)]

    def ring(self, now: float) -> list[Effect]:
        """No answer came, or the lease is to be renewed. A device without an answer to its renewal offers everything anew."""
        if self._step is _Step.RENEW:
            return self._go(_Step.RENEW if not self._waits_for else _Step.PUBLISH, now)
        return self._go(_Step.LOOK if self._step is _Step.ADD else self._step, now)

    def receive(self, message: Message, now: float) -> list[Effect]:
        """An answer; one to an earlier request than the last is out of date."""
        if message.header.relates_to != self._waits_for or self._step is _Step.LEFT:
            return []
        self._waits_for = ""
        match message.body:
            case Defined():
                return self._go(_Step.READ, now)
            case OntologyPage() as page:
                return self._read(page, now)
            case MapPage() as page:
                if page.objects and page.objects[0].name == self._profile.name:
                    self._object_type = page.objects[0].type
                    return self._go(_Step.PUBLISH, now)
                return self._go(_Step.ADD, now)
            case Updated():
                return self._go(_Step.PUBLISH, now)
            case Published(renew_within=within):
                effects: list[Effect] = [Wake(TIMER, now + within * 0.7)]
                if not self.joined:
                    self.joined = True
                    names = ", ".join(offer.service for offer in self._offers())
                    effects.append(_report(f"{self._profile.name} offers {names}", joined=True))
                self._step = _Step.RENEW
                return effects
            case Rejected(problems=problems):
                return self._trouble("\n".join(problems))
            case Fault() if self._step is _Step.RENEW:
                return self._go(_Step.PUBLISH, now)
            case Fault(text=text):
                return self._trouble(text)
            case _:
                return []

    def _read(self, page: OntologyPage, now: float) -> list[Effect]:
        wanted = {capability.type_name for capability in self._profile.capabilities}
        known = {one.name: one for one in page.definitions.services}
        self._types = {**{name: one for name, one in known.items() if name in wanted}, **self._types}
        self._seen |= set(known)
        if page.more:
            self._after = page.next
            return self._go(_Step.READ, now)
        self._after = 0
        if missing := sorted(wanted - set(self._types)):
            hints = [f"the common ontology has no service type {name}. {nearest(name, self._seen)}".rstrip() for name in missing]
            return self._trouble("\n".join([*hints, "name one that it has, or give @service a ServiceType"]))
        return self._go(_Step.LOOK, now)

    def _go(self, step: _Step, now: float) -> list[Effect]:
        """Take a step: make its request, and look after it when no answer comes."""
        profile = self._profile
        if step is _Step.READ and all(capability.type_name in self._types for capability in profile.capabilities):
            step = _Step.LOOK
        self._step = step
        to: str
        body: Body
        match step:
            case _Step.DEFINE:
                to, body = self._repository, Define(definitions=by_kind(profile.definitions), author=profile.name)
            case _Step.READ:
                to, body = self._repository, ReadOntology(after=self._after)
            case _Step.LOOK:
                to, body = self._repository, ReadMap(after=before(profile.name))
            case _Step.ADD:
                added = ObjectAdded(Object(name=profile.name, type=profile.type, values=profile.values))
                to, body = self._repository, UpdateMap(changes=(added,), situation=profile.situation, author=profile.name)
            case _Step.PUBLISH:
                to, body = self._registry, Publish(provider=profile.name, offers=self._offers(), lease=profile.lease)
            case _Step.RENEW:
                to, body = self._registry, Renew(provider=profile.name, lease=profile.lease)
            case _Step.LEFT:
                return []
        return [self._ask(to, body, now), Wake(TIMER, now + PATIENCE)]

    def _ask(self, to: str, body: Body, now: float) -> Send:
        self._asked += 1
        self._waits_for = message_id(self._address, self._incarnation, self._asked)
        header = Header(sender=self._address, recipient=to, message_id=self._waits_for, reply_to=self._address)
        return Send(Message(header=header, body=body), now + PATIENCE)

    def tell(self, situation: str, service: str, now: float) -> Send:
        """Have the Repository know what a service left of which no Task Manager waits to hear any more."""
        self._told += 1
        identity = message_id(self._address, self._incarnation, "told", self._told)
        header = Header(sender=self._address, recipient=self._repository, message_id=identity, reply_to=self._address)
        return Send(Message(header=header, body=UpdateMap(situation=situation, author=service)), now + TELLING)

    def _offers(self) -> tuple[Offer, ...]:
        return tuple(self._offer(capability) for capability in self._profile.capabilities)

    def _offer(self, capability: Capability) -> Offer:
        return Offer(
            service=self._profile.service(capability),
            provider=self._profile.name,
            provider_type=self._object_type,
            address=self._address,
            service_type=self._types[capability.type_name],
            attributes={**capability.attributes, **({AT_ONCE: self._profile.capacity} if self._profile.capacity != 1 else {})},
        )

    def _trouble(self, text: str) -> list[Effect]:
        return [Wake(TIMER, None), _report(f"{self._profile.name} cannot join: {text}", joined=False)]


def _report(text: str, *, joined: bool) -> Ask:
    return Ask("report", Report(text, joined))
