"""How a device joins the system and stays in it: its definitions and its object go to the Repository, its offers to the
Service Registry, under a lease that is renewed. Steps that get no answer are taken again.
"""

from __future__ import annotations

from enum import StrEnum

from msgspec import Struct

from somrs.entish.parse import nearest
from somrs.kernel.component import Ask, Effects, Send, SetTimer
from somrs.ontology.objects import Object, ObjectAdded
from somrs.ontology.services import ServiceType
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.directory import CAPACITY_ATTRIBUTE, Offer, Publish, Published, Renew, Retract
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
)
from somrs.service_manager.participant.timers import JoiningDue, ReportWanted
from somrs.service_manager.sdk.device import before
from somrs.service_manager.sdk.orders import Capability, Profile, Report

PATIENCE = 5.0
"""Seconds after which a request without an answer is made anew."""


class Step(StrEnum):
    """What comes next; in this order."""

    DEFINE = "bring new definitions"
    READ = "find the service types that are known by name only"
    LOOK = "look whether the device is on the map"
    ADD = "put it there"
    PUBLISH = "offer the services"
    RENEW = "renew the lease"
    LEFT = "it has left"


class Joining(Struct, kw_only=True):
    """The device, in its system, and how far it is with joining. Owned by a ServiceManager, which hands it the answers of Repository and
    Registry, and its timer. `waits_for` is the last request's id."""

    profile: Profile
    repository: str
    registry: str
    address: str = ""
    incarnation: float = 0.0
    asked: int = 0
    waits_for: str = ""
    after: int = 0
    types: dict[str, ServiceType] = {}
    seen: set[str] = set()
    object_type: str = ""
    step: Step = Step.DEFINE
    joined: bool = False

    def start(self, address: str, now: float) -> Effects:
        """Begin, whatever was done before."""
        profile = self.profile
        self.address, self.incarnation, self.joined, self.after = address, now, False, 0
        self.types = {one.type_name: one.type for one in profile.capabilities if isinstance(one.type, ServiceType)}
        self.seen, self.object_type = set(), profile.type
        yield from self._go(Step.DEFINE if any(profile.definitions.all_definitions()) else Step.READ, now)

    def leave(self, now: float) -> Effects:
        self.step = Step.LEFT
        yield SetTimer(JoiningDue(), None)
        yield self._ask(self.registry, Retract(provider=self.profile.name), now)

    def ring(self, now: float) -> Effects:
        """No answer came, or the lease is to be renewed. A device without an answer to its renewal offers everything anew."""
        if self.step is Step.RENEW:
            yield from self._go(Step.RENEW if not self.waits_for else Step.PUBLISH, now)
        else:
            yield from self._go(Step.LOOK if self.step is Step.ADD else self.step, now)

    def receive(self, message: Message, now: float) -> Effects:
        """An answer; one to an earlier request than the last is out of date."""
        if message.header.relates_to != self.waits_for or self.step is Step.LEFT:
            return
        self.waits_for = ""
        match message.body:
            case Defined():
                yield from self._go(Step.READ, now)
            case OntologyPage() as page:
                yield from self._read(page, now)
            case MapPage() as page:
                if page.objects and page.objects[0].name == self.profile.name:
                    self.object_type = page.objects[0].type
                    yield from self._go(Step.PUBLISH, now)
                else:
                    yield from self._go(Step.ADD, now)
            case Updated():
                yield from self._go(Step.PUBLISH, now)
            case Published(renew_within=within):
                yield SetTimer(JoiningDue(), now + within * 0.7)
                if not self.joined:
                    self.joined = True
                    names = ", ".join(offer.service for offer in self._offers())
                    yield Ask(ReportWanted(), Report(f"{self.profile.name} offers {names}", joined=True))
                self.step = Step.RENEW
            case Rejected(problems=problems):
                yield from self._trouble("\n".join(problems))
            case Fault() if self.step is Step.RENEW:
                yield from self._go(Step.PUBLISH, now)
            case Fault(text=text):
                yield from self._trouble(text)

    def _read(self, page: OntologyPage, now: float) -> Effects:
        wanted = {capability.type_name for capability in self.profile.capabilities}
        known = {one.name: one for one in page.definitions.services}
        self.types = {**{name: one for name, one in known.items() if name in wanted}, **self.types}
        self.seen |= set(known)
        if page.more:
            self.after = page.next
            yield from self._go(Step.READ, now)
            return
        self.after = 0
        if missing := sorted(wanted - set(self.types)):
            hints = [f"the common ontology has no service type {name}. {nearest(name, self.seen)}".rstrip() for name in missing]
            yield from self._trouble("\n".join([*hints, "name one that it has, or give @service a ServiceType"]))
        else:
            yield from self._go(Step.LOOK, now)

    def _go(self, step: Step, now: float) -> Effects:
        """Take a step: make its request, and look after it when no answer comes."""
        profile = self.profile
        if step is Step.READ and all(capability.type_name in self.types for capability in profile.capabilities):
            step = Step.LOOK
        self.step = step
        to: str
        body: Body
        match step:
            case Step.DEFINE:
                to, body = self.repository, Define(definitions=profile.definitions, author=profile.name)
            case Step.READ:
                to, body = self.repository, ReadOntology(after=self.after)
            case Step.LOOK:
                to, body = self.repository, ReadMap(after=before(profile.name))
            case Step.ADD:
                added = ObjectAdded(Object(name=profile.name, type=profile.type, values=profile.values))
                to, body = self.repository, UpdateMap(changes=(added,), situation=profile.situation, author=profile.name)
            case Step.PUBLISH:
                to, body = self.registry, Publish(provider=profile.name, offers=self._offers(), lease=profile.lease)
            case Step.RENEW:
                to, body = self.registry, Renew(provider=profile.name, lease=profile.lease)
            case Step.LEFT:
                return
        yield self._ask(to, body, now)
        yield SetTimer(JoiningDue(), now + PATIENCE)

    def _ask(self, to: str, body: Body, now: float) -> Send:
        self.asked += 1
        self.waits_for = message_id(self.address, self.incarnation, self.asked)
        header = Header(sender=self.address, recipient=to, message_id=self.waits_for, reply_to=self.address)
        return Send(Message(header=header, body=body), now + PATIENCE)

    def _offers(self) -> tuple[Offer, ...]:
        return tuple(self._offer(capability) for capability in self.profile.capabilities)

    def _offer(self, capability: Capability) -> Offer:
        return Offer(
            service=self.profile.service(capability),
            provider=self.profile.name,
            provider_type=self.object_type,
            address=self.address,
            service_type=self.types[capability.type_name],
            attributes={**capability.attributes, **({CAPACITY_ATTRIBUTE: self.profile.capacity} if self.profile.capacity != 1 else {})},
        )

    def _trouble(self, text: str) -> Effects:
        yield SetTimer(JoiningDue(), None)
        yield Ask(ReportWanted(), Report(f"{self.profile.name} cannot join: {text}", joined=False))
