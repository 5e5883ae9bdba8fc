"""The state machine of a simulated vehicle: `SimulatedVehicle.handle` takes what happens and the time, and returns what to do.

It follows the text of VDA 5050 in versions 2.1 and 3.0, and refuses what the text does not have.
"""

from __future__ import annotations

import math
from collections.abc import Collection

from somrs.adapters.vda5050.messages.factsheets import Factsheet
from somrs.adapters.vda5050.messages.header import Topic, Version
from somrs.adapters.vda5050.messages.orders import Action, Order
from somrs.adapters.vda5050.messages.states import ActionStatus, Connection, ErrorLevel, OperatingMode, State
from somrs.adapters.vda5050.simulated.acceptance import CLEARING, ORDERS_ALLOWED, Situation, instant_objection, is_repetition, objection
from somrs.adapters.vda5050.simulated.body import Charge, Command, Drive, Drop, Pick, Rest, Sensed
from somrs.adapters.vda5050.simulated.commands import BODILY, command_for, drive_command
from somrs.adapters.vda5050.simulated.complaints import Complaints
from somrs.adapters.vda5050.simulated.exchange import (
    Act,
    Connected,
    Effect,
    Faulted,
    Felt,
    Garbled,
    Input,
    Instructed,
    Misbehaves,
    Ordered,
    Pressed,
    Publish,
    Repaired,
    Responded,
    Restarted,
    Switched,
    Zoned,
)
from somrs.adapters.vda5050.simulated.instant import Ending, InstantLog
from somrs.adapters.vda5050.simulated.problems import Problem
from somrs.adapters.vda5050.simulated.progress import Progress
from somrs.adapters.vda5050.simulated.report import event_of, state_of
from somrs.adapters.vda5050.simulated.sleep import Sleep
from somrs.adapters.vda5050.simulated.storage import Storage
from somrs.adapters.vda5050.simulated.zones import ZoneGuard

RETRY = 2.0
"""Seconds after which the vehicle tries again to drive, when something was in its way."""
STORING = {"downloadMap", "enableMap", "deleteMap", "enableZoneSet", "deleteZoneSet"}
"""Instant actions about what the vehicle stores; those about zone sets are in 3.0 only."""


class SimulatedVehicle:
    """`map_id`: the map on which it is. `interval`: seconds between two states if nothing happens; the standard allows 30.
    `contour`: how far it extends around its middle, in metres."""

    def __init__(
        self, version: Version, sheet: Factsheet, *, map_id: str, maps: Collection[str] = (), interval: float = 1.0, contour: float = 0.25
    ) -> None:
        self.version, self._factsheet, self.map_id, self._interval = version, sheet, map_id, interval
        self.storage, self.zones = Storage({map_id, *maps}), ZoneGuard(contour=contour)
        self.progress, self.mode, self._paused = Progress(), OperatingMode.AUTOMATIC, False
        self._complaints, self._instant, self._sleep = Complaints(version), InstantLog(), Sleep()
        self._sensed: Sensed | None = None
        self._load: str | None = None
        self._busy: Command | None = None
        self._busy_action: str | None = None
        self._blocked_at: float | None = None
        self._number, self._habits = 0, Misbehaves()
        self._published: State | None = None
        self._published_at = -math.inf
        self._effects: list[Effect] = []

    def handle(self, input: Input, now: float) -> list[Effect]:
        """Take in what happened. Returns what to do, in this order."""
        self._effects = []
        if self._sleep.ignores(input):
            return []
        match input:
            case Felt(sensed=sensed):
                self._feel(sensed, now)
            case Ordered(order=order, deviations=deviations):
                self._receive(order, deviations)
            case Instructed(actions=instant_actions):
                for action in instant_actions.actions:
                    if action.action_id not in self._instant.states:
                        self._instruct(action, now)
            case Zoned(content=content):
                problem = self.storage.take(content, self._factsheet.type_specification.supported_zones or ())
                if problem is not None:
                    self._complaints.add(*problem, zoneSetId=content.zone_set_id)
            case Responded(responses=responses):
                self.zones.respond(responses)
            case Garbled(reason=reason):
                self._complaints.add(Problem.MALFORMED, reason)
            case Connected():
                self._publish_connection()
            case Switched(mode=mode):
                self._switch(mode)
            case Pressed(pauses=pauses):
                self._paused = pauses
            case Faulted(error=error):
                self._complaints.own.append(error)
            case Repaired():
                self._complaints.own = []
            case Restarted():
                self._restart()
            case Misbehaves():
                self._habits, self.storage.can_download = input, not input.cannot_download
        if self._sensed is not None and not self._sleep.is_asleep:
            self._work(now)
            self._publish_state(now)
            self._fall_asleep()
        return self._effects

    # Orders.

    def _receive(self, order: Order, deviations: tuple[str, ...]) -> None:
        situation = self._situation()
        wrong = [deviation for deviation in deviations if not deviation.endswith("is unknown")]
        problem = (Problem.MALFORMED, "; ".join(wrong)) if wrong else objection(order, situation)
        if problem is not None:
            self._complaints.add(*problem, orderId=order.order_id, orderUpdateId=str(order.order_update_id))
        elif is_repetition(order, situation):
            return
        else:
            self._complaints.forget_work()
            is_update = self.progress.order is not None and order.order_id == self.progress.order.order_id
            if is_update:
                self.progress.continue_with(order)
            else:
                self.progress.begin(order)
                if self.version is not Version.V3_0:
                    self._instant.drop_ended()
            self._blocked_at = None

    def _situation(self) -> Situation:
        sensed = self._sensed
        return Situation(
            version=self.version,
            order=self.progress.order,
            decision_point=self.progress.decision_point,
            is_idle=self.progress.is_idle and not self._instant.is_waiting(Ending.DOES_NOTHING),
            is_cancelled=self.progress.is_cancelled,
            is_available=self.mode in ORDERS_ALLOWED and not self._complaints.has(ErrorLevel.FATAL),
            x=sensed.x if sensed is not None else 0.0,
            y=sensed.y if sensed is not None else 0.0,
            maps=self.storage.enabled_maps,
            sheet=self._factsheet,
        )

    def _switch(self, mode: OperatingMode) -> None:
        if mode in CLEARING and not self.progress.is_idle:
            self.progress.clear()
            self._begin(Rest())
        if mode in CLEARING or mode is OperatingMode.INTERVENED:
            self.zones.clear()
        self.mode = mode

    def _restart(self) -> None:
        self.progress, self._paused, self._instant = Progress(), False, InstantLog()
        self._sleep.wake()
        self._complaints.forget_work()
        self.zones.clear()
        self._begin(Rest())
        self._publish_connection()

    # Instant actions (3.0, 6.2.1).

    def _instruct(self, action: Action, now: float) -> None:
        if (words := instant_objection(action, self.mode, self._factsheet)) is not None:
            self._complaints.add(Problem.INVALID_INSTANT_ACTION, words, actionId=action.action_id)
            self._instant.note(action, ActionStatus.FAILED)
            return
        status, ending = ActionStatus.FINISHED, None
        match action.action_type:
            case "cancelOrder":
                if self._habits.ignores_cancel:
                    return
                status, ending = self._cancel(action)
            case "startPause":
                self._paused = True
                status, ending = ActionStatus.RUNNING, Ending.STANDS
            case "stopPause":
                self._paused = False
            case "stateRequest":
                self._published_at = -math.inf
            case "factsheetRequest":
                self._effects.append(Publish(topic=Topic.FACTSHEET, message=self._factsheet))
            case "startCharging":
                self._begin(Charge())
            case "stopCharging":
                self._begin(Rest())
                status, ending = ActionStatus.RUNNING, Ending.IS_DISCONNECTED
            case "startHibernation" if self.version is Version.V3_0:
                self._clear_order()
                status, ending, self._sleep.action_id = ActionStatus.RUNNING, Ending.DOES_NOTHING, action.action_id
            case "stopHibernation" if self.version is Version.V3_0:
                self._sleep.wake()
                self._publish_connection()
            case "retry" | "skipRetry" if self.version is Version.V3_0:
                status = self._answer_failure(action)
            case "trigger":
                self.progress.trigger()
            case "initializePosition":
                self.map_id = str(action.parameter("mapId") or self.map_id)
                self.progress.last_node_id = str(action.parameter("lastNodeId") or "")
            case "clearInstantActions" | "clearZoneActions" if self.version is Version.V3_0:
                (self._instant if action.action_type == "clearInstantActions" else self.zones.actions).drop_ended()
            case action_type if action_type in STORING and (self.version is Version.V3_0 or not action_type.endswith("ZoneSet")):
                status, problem = self.storage.act(action, now)
                if problem is not None:
                    self._complaints.add(*problem, actionId=action.action_id)
            case _:
                status = ActionStatus.FAILED
                self._complaints.add(Problem.INVALID_INSTANT_ACTION, f"{action.action_type} is not supported", actionId=action.action_id)
        self._instant.note(action, status, ending)

    def _cancel(self, action: Action) -> tuple[ActionStatus, Ending | None]:
        """3.0, 6.1.3; 2.1, 6.6.3."""
        named = action.parameter("orderId")
        current = self.progress.order
        if self.progress.is_idle or (named is not None and current is not None and named != current.order_id):
            self._complaints.add(Problem.NO_ORDER, "there is no such order", actionId=action.action_id)
            return ActionStatus.FAILED, None
        if self._habits.rolls_on:
            self.progress.clear()
            self.zones.clear()
            return ActionStatus.FINISHED, None
        self._clear_order()
        return ActionStatus.RUNNING, Ending.DOES_NOTHING

    def _clear_order(self) -> None:
        """3.0, 6.6.7."""
        self.progress.clear()
        self.zones.clear()
        self._begin(Rest())

    def _answer_failure(self, instruction: Action) -> ActionStatus:
        """Try an action again that has failed, or give it up (3.0, 6.6.9)."""
        action = self.progress.retriable(str(instruction.parameter("actionId") or ""))
        if action is None:
            words = f"{instruction.parameter('actionId')} does not wait for another try"
            self._complaints.add(Problem.INVALID_INSTANT_ACTION, words, actionId=instruction.action_id)
            return ActionStatus.FAILED
        if instruction.action_type == "skipRetry":
            self.progress.set_status(action.action_id, ActionStatus.FAILED)
        else:
            self._complaints.forget(Problem.ACTION_FAILED)
            self._start(action)
        return ActionStatus.FINISHED

    def _fall_asleep(self) -> None:
        """Say so when the vehicle stands, after a last state."""
        state = self._instant.states.get(self._sleep.action_id or "")
        if state is not None and state.action_status is ActionStatus.FINISHED:
            self._sleep.action_id, self._sleep.is_asleep = None, True
            self._publish_connection()

    # The body.

    def _feel(self, sensed: Sensed, now: float) -> None:
        earlier, self._sensed = self._sensed or sensed, sensed
        if earlier is sensed:
            self._load = sensed.load
        if sensed.fault != earlier.fault or earlier is sensed:
            self._complaints.note_fault(sensed.fault)
        if sensed.map_id is not None and sensed.map_id != self.map_id:
            self.map_id = sensed.map_id
            self.progress.arrive_by_lift(self.map_id, (sensed.x, sensed.y))
        if isinstance(self._busy, Drive):
            self.progress.pass_nodes(self.map_id, (sensed.x, sensed.y), (earlier.x, earlier.y))
        if self._busy is not None and sensed.finished == self._number:
            self._end_command(self._busy, sensed.failure, now)
        if not sensed.is_moving and not isinstance(self._busy, Drive):
            self._instant.has_come(Ending.STANDS)
            if self._busy is None or isinstance(self._busy, Rest):
                self._instant.has_come(Ending.DOES_NOTHING)
        if not sensed.is_charging:
            self._instant.has_come(Ending.IS_DISCONNECTED)
        for action_id, status in self.storage.ended_downloads(now):
            self._instant.end(action_id, status)
        self._look_at_zones(sensed, now)

    def _look_at_zones(self, sensed: Sensed, now: float) -> None:
        """Zones count in modes in which the vehicle drives by itself."""
        if self.mode in ORDERS_ALLOWED and self.mode is not OperatingMode.INTERVENED:
            content, progress = self.storage.enabled_zones(self.map_id), self.progress
            self.zones.look(content, self.map_id, (sensed.x, sensed.y), progress.nodes, progress.edges, now)
            self._complaints.note_zones(self.zones.errors())

    def _end_command(self, command: Command, failure: str | None, now: float) -> None:
        action_id, self._busy, self._busy_action = self._busy_action, None, None
        match command:
            case Drive() if failure is not None:
                self._blocked_at = now
                self._complaints.add(Problem.BLOCKED, failure)
            case Drive(points=points):
                nodes, _ = self.progress.leg(self.map_id)
                position = nodes[0].node_position if nodes else None
                if position is not None and math.dist((position.x, position.y), points[-1]) < 1e-6:
                    self.progress.traverse()
                self._complaints.forget(Problem.BLOCKED)
            case Pick() | Drop() if failure is None:
                self._load = command.load if isinstance(command, Pick) else None
            case Pick() | Drop() | Rest() if self._sensed is not None:  # what was interrupted may have been done
                self._load = self._sensed.load
            case Charge():
                self._busy = command
        if action_id is not None:
            failed = ActionStatus.RETRIABLE if self.progress.actions[action_id].retriable else ActionStatus.FAILED
            self.progress.set_status(action_id, failed if failure is not None else ActionStatus.FINISHED, failure)
            if failure is not None:
                self._complaints.add(Problem.ACTION_FAILED, failure, actionId=action_id)

    def _begin(self, command: Command, action_id: str | None = None) -> None:
        self._number += 1
        self._busy, self._busy_action = command, action_id
        self._effects.append(Act(number=self._number, command=command))

    def _halt_driving(self) -> None:
        if isinstance(self._busy, Drive):
            self._begin(Rest())

    def _work(self, now: float) -> None:
        """Begin what can begin: actions first, then driving."""
        stopped = self._paused or self.mode not in (OperatingMode.AUTOMATIC, OperatingMode.SEMIAUTOMATIC)
        if stopped or self._complaints.has(ErrorLevel.FATAL, ErrorLevel.CRITICAL):
            self._halt_driving()
            return
        if self.progress.must_stand() or self.zones.is_closed:
            self._halt_driving()
        for action in self.progress.startable():
            self._start(action)
        if not self.progress.must_stand() and not self._instant.is_waiting(Ending.DOES_NOTHING):
            self._drive(now)

    def _start(self, action: Action) -> None:
        if action.action_type == "waitForTrigger":
            self.progress.set_status(action.action_id, ActionStatus.RUNNING)
            return
        if action.action_type not in BODILY:
            self.progress.set_status(action.action_id, ActionStatus.FINISHED)
            return
        assert self._sensed is not None, "work begins when the body is felt"
        if self._sensed.is_moving or (self._busy is not None and not isinstance(self._busy, Charge)):
            return
        self.progress.set_status(action.action_id, ActionStatus.RUNNING)
        self._begin(command_for(action, self._load), action.action_id)

    def _drive(self, now: float) -> None:
        nodes, edges = self.progress.leg(self.map_id)
        nodes, edges = nodes[: self.zones.open_nodes()], edges[: self.zones.open_nodes()]
        if nodes and (obstacle := self.zones.obstacle()) is not None:
            self._complaints.add(Problem.UNREACHABLE, obstacle, nodeId=nodes[0].node_id)
            return
        if not nodes or (self._busy is not None and not isinstance(self._busy, Drive | Charge)):
            return
        if self._blocked_at is not None and now < self._blocked_at + RETRY:
            return
        self._blocked_at = None
        command = drive_command(nodes, edges, self.map_id, self.zones.speed_limit(len(nodes)))
        if isinstance(self._busy, Drive) and self._busy.points[-1:] == command.points[-1:]:
            return
        for action in edges[0].actions:
            if action not in self.progress.queue:
                self.progress.queue.append(action)
        self._begin(command)

    # What it says.

    def _publish_connection(self) -> None:
        self._effects.append(Publish(topic=Topic.CONNECTION, message=Connection(connection_state=self._sleep.connection_state)))
        self._effects.append(Publish(topic=Topic.FACTSHEET, message=self._factsheet))
        self._published_at = -math.inf

    def _publish_state(self, now: float) -> None:
        """Publish the state if something has changed but the pose and the charge, or if it is time (3.0, 6.6)."""
        state = self.state()
        event = event_of(state)
        if event != self._published or now >= self._published_at + self._interval:
            self._published, self._published_at = event, now
            self._effects.append(Publish(topic=Topic.STATE, message=state))

    def state(self) -> State:
        """The state as the vehicle reports it now."""
        assert self._sensed is not None, "a state is reported when the body is felt"
        return state_of(
            self._sensed,
            self.progress,
            self._instant,
            self._complaints,
            self.storage,
            self.zones,
            version=self.version,
            map_id=self.map_id,
            mode=self.mode,
            is_paused=self._paused,
            load=self._load,
        )
