"""How a device joins the system and stays in it.

It adds its definitions and its object to the Repository, reads the definitions of its service types there, publishes its offers in the
Service Registry, and renews their lease. A request without an answer is repeated.

The service types may change while the device is there: when the Registry says so, the device reads them and publishes again. A service
whose author wrote another definition is not listed (`withheld`); the device then reads the definitions again with each renewal.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum

from msgspec import Struct, field, structs

from somrs.entish.parse import nearest
from somrs.kernel.component import Ask, Effects, Send, SetTimer
from somrs.ontology.agreement import disagreements
from somrs.ontology.objects import Object, ObjectAdded
from somrs.ontology.services import Parameter, ServiceType
from somrs.ontology.types import ROOT
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.directory import (
    CAPACITY_ATTRIBUTE,
    UNOCCUPIED,
    Offer,
    Publish,
    Published,
    Renew,
    Retract,
    ServiceTypesChanged,
    Withheld,
)
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import (
    Define,
    Defined,
    MapPage,
    OntologyPage,
    QueryMap,
    ReadMap,
    ReadOntology,
    Rejected,
    Rows,
    Updated,
    UpdateMap,
)
from somrs.service_manager.participant.timers import JoiningDue, ReportWanted
from somrs.service_manager.sdk.map_reader import predecessor_name
from somrs.service_manager.sdk.orders import Capability, Profile, Report

PATIENCE = 5.0
"""Seconds after which a request without an answer is repeated."""


class JoinStep(StrEnum):
    """The next step of joining, in this order."""

    DEFINE = "bring new definitions"
    READ = "read the definitions of the service types"
    LOOK = "look whether the device is on the map"
    COMPARE = "ask whether its object there is of the type that the program serves"
    ADD = "put it there"
    PUBLISH = "offer the services"
    RENEW = "renew the lease"
    DEPARTED = "it has left"


class Joining(Struct, kw_only=True):
    """The device, the system it joins, and the progress of joining.

    A ServiceManager owns it, and passes it the answers of Repository and Registry, and its timer. `pending_request` is the id of the last
    request. `types`: the service types as the Repository defines them in the version `ontology_version`, which changed the ontology last.
    `withheld`: the services that the Registry does not list, and why. `other_registries`: those of the site besides `registry`, as far as
    known. The device publishes at one of them if that does not answer.
    """

    profile: Profile
    repository: str
    registry: str
    address: str = ""
    incarnation: float = 0.0
    request_count: int = field(default=0, name="asked")
    pending_request: str = field(default="", name="waits_for")
    ontology_offset: int = field(default=0, name="after")
    types: dict[str, ServiceType] = {}
    seen_names: set[str] = field(default=set(), name="seen")
    object_type: str = ""
    step: JoinStep = JoinStep.DEFINE
    joined: bool = False
    ontology_version: int = 0
    withheld: dict[str, str] = {}
    other_registries: tuple[str, ...] = ()

    def start(self, address: str, now: float) -> Effects:
        """Begin from the first step."""
        profile = self.profile
        self.address, self.incarnation, self.joined, self.ontology_offset = address, now, False, 0
        self.types, self.withheld, self.seen_names, self.object_type = {}, {}, set(), profile.type
        yield from self._take_step(JoinStep.DEFINE if any(profile.definitions.all_definitions()) else JoinStep.READ, now)

    def depart(self, now: float) -> Effects:
        self.step = JoinStep.DEPARTED
        yield SetTimer(JoiningDue(), None)
        for registry in (*self.other_registries, self.registry):  # it may have published at others before
            yield self._ask(registry, Retract(provider=self.profile.name), now)

    def services_changed(self, profile: Profile, now: float) -> Effects:
        """Offer the services of this profile from now on."""
        self.profile = profile
        if self.joined:
            yield from self._read_types_again(now)

    def _read_types_again(self, now: float) -> Effects:
        self.ontology_offset = 0
        yield from self._take_step(JoinStep.READ, now)

    def timer_fired(self, now: float) -> Effects:
        """Repeat a request without an answer, or renew the lease. A device whose renewal has no answer publishes its offers again, at
        another Registry of the site if there is one."""
        if self.pending_request and self.step in (JoinStep.PUBLISH, JoinStep.RENEW) and self.other_registries:
            self.registry, *remaining = (*self.other_registries, self.registry)
            self.other_registries = tuple(remaining)
        if self.step is JoinStep.RENEW:
            due_step = JoinStep.READ if self.withheld else JoinStep.RENEW
            yield from self._take_step(due_step if not self.pending_request else JoinStep.PUBLISH, now)
        else:
            yield from self._take_step(JoinStep.LOOK if self.step in (JoinStep.ADD, JoinStep.COMPARE) else self.step, now)

    def receive(self, message: Message, now: float) -> Effects:
        """Handle an answer or a notification. An answer to an earlier request is out of date and ignored."""
        if isinstance(message.body, ServiceTypesChanged):
            if self.joined:
                yield from self._read_types_again(now)
            return
        if message.header.relates_to != self.pending_request or self.step is JoinStep.DEPARTED:
            return
        self.pending_request = ""
        match message.body:
            case Defined():
                yield from self._take_step(JoinStep.READ, now)
            case OntologyPage() as page:
                yield from self._collect_types(page, now)
            case MapPage() as page:
                if page.objects and page.objects[0].name == self.profile.name:
                    self.object_type = page.objects[0].type
                    is_of_type = self.object_type == self.profile.type
                    yield from self._take_step(JoinStep.PUBLISH if is_of_type else JoinStep.COMPARE, now)
                else:
                    yield from self._take_step(JoinStep.ADD, now)
            case Rows(rows=[_, *_]):
                yield from self._take_step(JoinStep.PUBLISH, now)
            case Rows() | Fault() if self.step is JoinStep.COMPARE:
                yield from self._report_problem(self._mismatch())
            case Updated():
                yield from self._take_step(JoinStep.PUBLISH, now)
            case Published() as published:
                yield SetTimer(JoiningDue(), now + published.renew_within * 0.7)
                self.other_registries = (
                    tuple(address for address in published.other_registries if address != self.registry) or self.other_registries
                )
                yield from self._published(published.withheld)
                self.step = JoinStep.RENEW
            case Rejected(problems=problems):
                yield from self._report_problem("\n".join(problems))
            case Fault() if self.step is JoinStep.RENEW:
                yield from self._take_step(JoinStep.PUBLISH, now)
            case Fault(text=text):
                yield from self._report_problem(text)

    def _published(self, withheld: tuple[Withheld, ...]) -> Effects:
        """Report which services are listed, when the device has joined and whenever this changes."""
        offered_names = {capability.type_name for capability in self._offered_capabilities()}
        undefined = [capability for capability in self.profile.capabilities if capability.type_name not in offered_names]
        reasons = {self.profile.service(capability): self._undefined(capability.type_name) for capability in undefined}
        reasons |= {entry.service: entry.reason for entry in withheld}
        if not self.joined or reasons != self.withheld:
            self.withheld = reasons
            listed = [offer.service for offer in self._offers() if offer.service not in reasons]
            lines = [f"{self.profile.name} offers {', '.join(listed) or 'nothing'}"]
            lines += [f"{service} is not on offer: {reason}" for service, reason in reasons.items()]
            yield Ask(ReportWanted(), Report("\n".join(lines), joined=None if self.joined else True))
        self.joined = True

    def _collect_types(self, page: OntologyPage, now: float) -> Effects:
        needed_types = {capability.type_name for capability in self.profile.capabilities}
        defined_types = {service_type.name: service_type for service_type in page.definitions.services}
        self.types |= {name: service_type for name, service_type in defined_types.items() if name in needed_types}
        self.seen_names = set(defined_types) | (self.seen_names if self.ontology_offset else set())
        self.ontology_version = page.changed_at
        if page.more and not needed_types <= self.seen_names:
            self.ontology_offset = page.next
            yield from self._take_step(JoinStep.READ, now)
            return
        self.ontology_offset = 0
        if self._offered_capabilities():
            yield from self._take_step(JoinStep.PUBLISH if self.joined else JoinStep.LOOK, now)
        else:
            hints = [f"{self._undefined(name)}. {nearest(name, self.seen_names)}".rstrip() for name in sorted(needed_types)]
            yield from self._report_problem("\n".join([*hints, "use one of its names, or pass a ServiceType to @service"]))

    def _offered_capabilities(self) -> list[Capability]:
        """The capabilities whose service types the ontology defines or the device brings."""
        return [c for c in self.profile.capabilities if isinstance(c.type, ServiceType) or c.type_name in self.types]

    def _undefined(self, service_type: str) -> str:
        return f"the common ontology has no service type {service_type}"

    def _mismatch(self) -> str:
        name, type = self.profile.name, self.profile.type
        return (
            f"{name} is a {self.object_type} on the map, and this program serves a {type}: "
            f"choose an object that is a {type}, or a name that is not on the map"
        )

    def _take_step(self, step: JoinStep, now: float) -> Effects:
        """Take a step: send its request, and set a timer to repeat it."""
        profile = self.profile
        self.step = step
        recipient: str
        body: Body
        match step:
            case JoinStep.DEFINE:
                recipient, body = self.repository, Define(definitions=profile.definitions, author=profile.name, brought=True)
            case JoinStep.READ:
                recipient, body = self.repository, ReadOntology(after=self.ontology_offset)
            case JoinStep.LOOK:
                recipient, body = self.repository, ReadMap(after=predecessor_name(profile.name))
            case JoinStep.COMPARE:
                recipient, body = self.repository, QueryMap(formula=f"?Device: {profile.type} = {profile.name}", limit=1)
            case JoinStep.ADD:
                addition = ObjectAdded(Object(name=profile.name, type=profile.type, values=profile.values))
                recipient, body = self.repository, UpdateMap(changes=(addition,), situation=profile.situation, author=profile.name)
            case JoinStep.PUBLISH:
                recipient, body = self.registry, self._publication()
            case JoinStep.RENEW:
                recipient, body = self.registry, Renew(provider=profile.name, lease=profile.lease)
            case JoinStep.DEPARTED:
                return
        yield self._ask(recipient, body, now)
        yield SetTimer(JoiningDue(), now + PATIENCE)

    def _ask(self, recipient: str, body: Body, now: float) -> Send:
        self.request_count += 1
        self.pending_request = message_id(self.address, self.incarnation, self.request_count)
        header = Header(sender=self.address, recipient=recipient, message_id=self.pending_request, reply_to=self.address)
        return Send(Message(header=header, body=body), now + PATIENCE)

    def _publication(self) -> Publish:
        profile = self.profile
        return Publish(provider=profile.name, offers=self._offers(), lease=profile.lease, ontology_version=self.ontology_version)

    def _offers(self) -> tuple[Offer, ...]:
        return tuple(self._offer(capability) for capability in self._offered_capabilities())

    def _offer(self, capability: Capability) -> Offer:
        capacity = self.profile.capacity if capability.occupies else UNOCCUPIED
        return Offer(
            service=self.profile.service(capability),
            provider=self.profile.name,
            provider_type=self.object_type,
            address=self.address,
            service_type=self._service_type(capability),
            attributes={**capability.attributes, **({CAPACITY_ATTRIBUTE: capacity} if capacity != 1 else {})},
        )

    def _service_type(self, capability: Capability) -> ServiceType:
        """The definition with which a service is offered: the common one, unless the author wrote one that disagrees with it.

        If the method reads other inputs than the common one has, the offer names those that it reads, so that the Registry withholds it.
        """
        common, brought = self.types.get(capability.type_name), capability.type
        if isinstance(brought, ServiceType) and (common is None or disagreements(brought, common, provides=True)):
            return brought
        assert common is not None, "a device without the definition of a service type does not join"
        if capability.inputs is None or capability.serves(common):
            return common
        return structs.replace(common, inputs=_named(capability.inputs, common.inputs), outputs=_named(capability.outputs, common.outputs))

    def _report_problem(self, text: str) -> Effects:
        yield SetTimer(JoiningDue(), None)
        yield Ask(ReportWanted(), Report(f"{self.profile.name} cannot join: {text}", joined=False))


def _named(names: Sequence[str], defined: Sequence[Parameter]) -> tuple[Parameter, ...]:
    """Parameters of these names, with the types of those that are defined: of the same name, or else in the same place."""
    types = {parameter.name: parameter.type for parameter in defined}
    places = [parameter.type for parameter in defined] + [ROOT] * len(names)
    return tuple(Parameter(name=name, type=types.get(name, place)) for name, place in zip(names, places, strict=False))
