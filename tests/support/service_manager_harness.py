"""A Service Manager that is up, with its device and its coordinator, input by input."""

from __future__ import annotations

import msgspec

from somrs.kernel.component import Answered, Effect, Received, Send, Started, TimerFired
from somrs.protocol.frp.coordinator_session import CoordinatorSession
from somrs.protocol.frp.session import CoordinatorBody
from somrs.protocol.messages import frp
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.frp import State
from somrs.service_manager.participant.participant import ServiceManager
from somrs.service_manager.participant.timers import Activity, HeartbeatDue, StartDue, TermsDue, WorkWanted
from somrs.service_manager.sdk.orders import Answer, Capability, Order, Profile, Quoted, WorkDone
from tests.support.effects import bodies
from tests.support.lab import CLIENT, REPOSITORY

REGISTRY, ME, ELSEWHERE = "http://here/registry", "http://here/washer", "http://there/washer"
PROFILE = Profile(
    name="Washer1",
    type="Washer",
    capabilities=(
        Capability(type="WashObject", method="wash", undoable=True),
        Capability(type="WashObject", method="scrub"),
        Capability(type="DryObject", method="dry"),
    ),
)
ARRANGE = frp.Arrange(
    service_type="WashObject", inputs={"Object": "Jar1"}, effect="?Object isOn ?Provider", precondition="Jar1 isOn Table1"
)
EXECUTE = frp.Execute(inputs={})
NOW = 100.0


class ServiceManagerHarness:
    """A Service Manager that is up, and the coordinator of one step of it."""

    def __init__(self, participant: str = "Washer1.WashObject#s1", profile: Profile = PROFILE) -> None:
        self.manager = ServiceManager(profile, repository=REPOSITORY, registry=REGISTRY)
        self.manager.handle(Started(ME), 0.0)
        self.participant = participant
        self.session = self.make_session(participant)
        self.now = NOW

    @staticmethod
    def make_session(participant: str) -> CoordinatorSession:
        return CoordinatorSession(transaction="t1", participant=participant, me=CLIENT, peer=ME)

    def hear(self, message: Message) -> list[Effect]:
        """What the Service Manager does about a message; the coordinator hears its answers."""
        return self._deliver(self.manager.handle(Received(message), self.now))

    def ask(self, body: CoordinatorBody) -> list[Effect]:
        return self.hear(self.session.send(body))

    def device_answers(self, activity: Activity, answer: Answer) -> list[Effect]:
        return self._deliver(self.manager.handle(Answered(self.question_for(activity), answer), self.now))

    def ring(self, timer: TermsDue | StartDue | HeartbeatDue) -> list[Effect]:
        return self._deliver(self.manager.handle(TimerFired(timer), self.now))

    def question_for(self, activity: Activity) -> WorkWanted:
        return WorkWanted("t1", self.participant, activity)

    def offered(self, **order: float) -> frp.Terms | frp.Refuse:
        self.ask(msgspec.structs.replace(ARRANGE, **order))
        [body] = bodies(self.device_answers(Activity.QUOTE, Quoted(price=2.0, duration=60.0)))
        assert isinstance(body, frp.Terms | frp.Refuse)
        return body

    def committed(self, **order: float) -> list[Effect]:
        self.offered(**order)
        return self.hear(self.session.accept())

    def executing(self) -> list[Effect]:
        self.committed()
        return self.ask(EXECUTE)

    def completed(self) -> list[Effect]:
        self.executing()
        return self.device_answers(Activity.PERFORM, WorkDone())

    @property
    def state(self) -> State:
        return self.manager.state_of("t1", self.participant)

    def _deliver(self, effects: list[Effect]) -> list[Effect]:
        for effect in effects:
            if isinstance(effect, Send) and effect.message.header.participant == self.session.participant:
                self.session.receive(effect.message)
        return effects


def expiry_times(effects: list[Effect]) -> list[float | None]:
    return [effect.expires_at for effect in effects if isinstance(effect, Send)]


def rest(effects: list[Effect]) -> list[Effect]:
    return [effect for effect in effects if not isinstance(effect, Send)]


def timers(
    kind: type[TermsDue | StartDue | HeartbeatDue], participant: str = "Washer1.WashObject#s1"
) -> TermsDue | StartDue | HeartbeatDue:
    return kind("t1", participant)


def order(**changed: object) -> Order:
    plain = Order(
        transaction="t1",
        participant="Washer1.WashObject#s1",
        method="wash",
        inputs={"Object": "Jar1"},
        effect="?Object isOn ?Provider",
        precondition="Jar1 isOn Table1",
    )
    return msgspec.structs.replace(plain, **changed)
