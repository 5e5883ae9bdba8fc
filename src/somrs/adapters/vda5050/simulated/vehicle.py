"""The state machine of a simulated vehicle: `SimulatedVehicle.handle` takes what happens and the time, and returns what to do.

It follows the text of VDA 5050 in versions 2.1 and 3.0, and refuses what the text does not have.
"""

from __future__ import annotations

import math
from collections.abc import Collection

import msgspec

from somrs.adapters.vda5050.messages.factsheets import Factsheet
from somrs.adapters.vda5050.messages.header import Topic, Version
from somrs.adapters.vda5050.messages.orders import Action, Order
from somrs.adapters.vda5050.messages.states import (
    ActionState,
    ActionStatus,
    Connection,
    ConnectionState,
    EmergencyStop,
    ErrorLevel,
    Load,
    MapStatus,
    OperatingMode,
    Position,
    PowerSupply,
    SafetyState,
    State,
    StoredMap,
    VehicleError,
)
from somrs.adapters.vda5050.simulated.acceptance import CLEARING, ORDERS_ALLOWED, TOLERANCE, Situation, is_repetition, objection
from somrs.adapters.vda5050.simulated.body import Charge, Command, Drive, Drop, Pick, Rest, Sensed
from somrs.adapters.vda5050.simulated.corners import has_come
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
    Restarted,
    Switched,
)
from somrs.adapters.vda5050.simulated.problems import Problem
from somrs.adapters.vda5050.simulated.progress import Progress

RETRY = 2.0
"""Seconds after which the vehicle tries again to drive, when something was in its way."""


DRIVE_ERROR = "driveError"
"""The type of the error of a vehicle whose drive is dead."""


class SimulatedVehicle:
    """`map_id`: the map on which it is. `interval`: seconds between two states if nothing happens; the standard allows 30."""

    def __init__(self, version: Version, sheet: Factsheet, *, map_id: str, maps: Collection[str] = (), interval: float = 1.0) -> None:
        self.version, self._factsheet, self.map_id, self._interval = version, sheet, map_id, interval
        self._maps = frozenset({map_id, *maps})
        self.progress = Progress()
        self.mode = OperatingMode.AUTOMATIC
        self._paused = False
        self._own_errors: list[VehicleError] = []
        self._complaints: list[VehicleError] = []
        self._instant: dict[str, ActionState] = {}
        self._sensed: Sensed | None = None
        self._place: tuple[float, float] | None = None
        """Where it was sensed last."""
        self._load: str | None = None
        self._number = 0
        self._busy: Command | None = None
        self._busy_action: str | None = None
        self._cancelling: list[str] = []
        self._pausing: list[str] = []
        self._disconnecting: list[str] = []
        self._blocked_at: float | None = None
        self._habits = Misbehaves()
        self._published: State | None = None
        self._published_at = -math.inf
        self._effects: list[Effect] = []

    def handle(self, input: Input, now: float) -> list[Effect]:
        """Take in what happened. Returns what to do, in this order."""
        self._effects = []
        match input:
            case Felt(sensed=sensed):
                self._feel(sensed, now)
            case Ordered(order=order, deviations=deviations):
                self._receive(order, deviations)
            case Instructed(actions=instant_actions):
                for action in instant_actions.actions:
                    if action.action_id not in self._instant:
                        self._instruct(action, now)
            case Garbled(reason=reason):
                self._complain(Problem.MALFORMED, reason)
            case Connected():
                self._publish_connection()
            case Switched(mode=mode):
                self._switch(mode)
            case Pressed(pauses=pauses):
                self._paused = pauses
                if pauses:
                    self._halt_driving()
            case Faulted(error=error):
                self._own_errors.append(error)
            case Repaired():
                self._own_errors = []
            case Restarted():
                self._restart()
            case Misbehaves():
                self._habits = input
        if self._sensed is not None:
            self._work(now)
            self._publish_state(now)
        return self._effects

    # Orders.

    def _receive(self, order: Order, deviations: tuple[str, ...]) -> None:
        situation = self._situation()
        wrong = [deviation for deviation in deviations if not deviation.endswith("is unknown")]
        problem = (Problem.MALFORMED, "; ".join(wrong)) if wrong else objection(order, situation)
        if problem is not None:
            self._complain(*problem, orderId=order.order_id, orderUpdateId=str(order.order_update_id))
        elif is_repetition(order, situation):
            return
        else:
            self._complaints = []
            is_update = self.progress.order is not None and order.order_id == self.progress.order.order_id
            if is_update:
                self.progress.continue_with(order)
            else:
                self.progress.begin(order)
                if self.version is not Version.V3_0:
                    self._instant = {key: state for key, state in self._instant.items() if not state.action_status.is_final}
            self._blocked_at = None

    def _situation(self) -> Situation:
        sensed = self._sensed
        return Situation(
            version=self.version,
            order=self.progress.order,
            decision_point=self.progress.decision_point,
            is_idle=self.progress.is_idle and not self._cancelling,
            is_cancelled=self.progress.is_cancelled,
            is_available=self.mode in ORDERS_ALLOWED and not self._has_error(ErrorLevel.FATAL),
            x=sensed.x if sensed is not None else 0.0,
            y=sensed.y if sensed is not None else 0.0,
            maps=self._maps,
            takes_trajectories=self._factsheet.takes("edges.trajectory"),
        )

    def _complain(self, problem: Problem, description: str, **references: str) -> None:
        error = problem.error(self.version, description, **references)
        if error not in self._complaints:
            self._complaints.append(error)

    def _has_error(self, *levels: ErrorLevel) -> bool:
        return any(error.error_level in levels for error in (*self._own_errors, *self._complaints))

    def _switch(self, mode: OperatingMode) -> None:
        if mode in CLEARING and not self.progress.is_idle:
            self.progress.clear()
            self._begin(Rest())
        self.mode = mode

    def _restart(self) -> None:
        self.progress, self._paused, self._cancelling, self._pausing, self._disconnecting = Progress(), False, [], [], []
        self._instant, self._complaints = {}, []
        self._begin(Rest())
        self._publish_connection()

    # Instant actions (3.0, 6.2.1).

    def _instruct(self, action: Action, now: float) -> None:
        status = ActionStatus.FINISHED
        match action.action_type:
            case "cancelOrder":
                if self._habits.ignores_cancel:
                    return
                status = self._cancel(action)
            case "startPause":
                self._paused = True
                self._halt_driving()
                self._pausing.append(action.action_id)
                status = ActionStatus.RUNNING
            case "stopPause":
                self._paused = False
            case "stateRequest":
                self._published_at = -math.inf
            case "factsheetRequest":
                self._effects.append(Publish(topic=Topic.FACTSHEET, message=self._factsheet))
            case "stopCharging":
                self._begin(Rest())
                self._disconnecting.append(action.action_id)
                status = ActionStatus.RUNNING
            case "trigger":
                for queued in [item for item in self.progress.queue if item.action_type == "waitForTrigger"]:
                    self.progress.set_status(queued.action_id, ActionStatus.FINISHED)
            case "initializePosition":
                self.map_id = str(action.parameter("mapId") or self.map_id)
                self.progress.last_node_id = str(action.parameter("lastNodeId") or "")
            case "clearInstantActions" if self.version is Version.V3_0:
                self._instant = {key: state for key, state in self._instant.items() if not state.action_status.is_final}
            case _:
                status = ActionStatus.FAILED
                self._complain(Problem.INVALID_INSTANT_ACTION, f"{action.action_type} is not supported", actionId=action.action_id)
        self._instant[action.action_id] = ActionState(action_id=action.action_id, action_type=action.action_type, action_status=status)

    def _cancel(self, action: Action) -> ActionStatus:
        """3.0, 6.1.3; 2.1, 6.6.3."""
        named = action.parameter("orderId")
        current = self.progress.order
        if self.progress.is_idle or (named is not None and current is not None and named != current.order_id):
            self._complain(Problem.NO_ORDER, "there is no such order", actionId=action.action_id)
            return ActionStatus.FAILED
        self.progress.clear()
        if self._habits.rolls_on:
            return ActionStatus.FINISHED
        self._begin(Rest())
        self._cancelling.append(action.action_id)
        return ActionStatus.RUNNING

    # The body.

    def _feel(self, sensed: Sensed, now: float) -> None:
        if sensed.fault != (self._sensed.fault if self._sensed is not None else None):
            self._note_fault(sensed.fault)
        self._sensed = sensed
        if sensed.map_id is not None and sensed.map_id != self.map_id:
            self.map_id = sensed.map_id
            self._arrive_by_lift(sensed)
        self._see_nodes(sensed)
        if self._busy is not None and sensed.finished == self._number:
            self._end_command(self._busy, sensed.failure, now)
        if not sensed.is_moving and not isinstance(self._busy, Drive):
            self._finish(self._pausing)
        if not sensed.is_moving and (self._busy is None or isinstance(self._busy, Rest)):
            self._finish(self._cancelling)
        if not sensed.is_charging:
            self._finish(self._disconnecting)

    def _note_fault(self, fault: str | None) -> None:
        """The body cannot move any more, or can again."""
        self._own_errors = [error for error in self._own_errors if error.error_type != DRIVE_ERROR]
        if fault is not None:
            self._own_errors.append(VehicleError(error_type=DRIVE_ERROR, error_level=ErrorLevel.FATAL, error_description=fault))

    def _finish(self, action_ids: list[str]) -> None:
        """The instant actions of these ids have come to their end."""
        for action_id in action_ids:
            self._instant[action_id] = msgspec.structs.replace(self._instant[action_id], action_status=ActionStatus.FINISHED)
        action_ids.clear()

    def _see_nodes(self, sensed: Sensed) -> None:
        """Traverse the nodes that are passed on the way; where the vehicle has to stop, it comes to the end of its leg at first."""
        nodes, _ = self.progress.leg(self.map_id)
        place, earlier = (sensed.x, sensed.y), self._place
        self._place = place
        while isinstance(self._busy, Drive) and len(nodes) > 1 and has_come(nodes, place, earlier or place):
            self.progress.traverse()
            del nodes[0]

    def _arrive_by_lift(self, sensed: Sensed) -> None:
        """The vehicle leaves the map of a floor, and is at the node of the lift on the map of another one (3.0, 7.3)."""
        node = self.progress.nodes[0] if self.progress.nodes else None
        position = node.node_position if node is not None and node.released else None
        if position is None or position.map_id != self.map_id:
            return
        if math.hypot(position.x - sensed.x, position.y - sensed.y) <= TOLERANCE:
            self.progress.traverse()

    def _end_command(self, command: Command, failure: str | None, now: float) -> None:
        self._busy, action_id = None, self._busy_action
        self._busy_action = None
        match command:
            case Drive() if failure is not None:
                self._blocked_at = now
                self._complain(Problem.BLOCKED, failure)
            case Drive(points=points):
                nodes, _ = self.progress.leg(self.map_id)
                position = nodes[0].node_position if nodes else None
                if position is not None and math.dist((position.x, position.y), points[-1]) < 1e-6:
                    self.progress.traverse()
                self._complaints = [error for error in self._complaints if error.error_type.lower() != "blocked"]
            case Pick(load=load) if failure is None:
                self._load = load
            case Drop() if failure is None:
                self._load = None
            case Charge():
                self._busy = command
        if action_id is not None:
            self.progress.set_status(action_id, ActionStatus.FAILED if failure is not None else ActionStatus.FINISHED, failure)
            if failure is not None:
                self._complain(Problem.ACTION_FAILED, failure, actionId=action_id)

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
        if stopped or self._has_error(ErrorLevel.FATAL, ErrorLevel.CRITICAL):
            self._halt_driving()
            return
        if self.progress.must_stand():
            self._halt_driving()
        for action in self.progress.startable():
            self._start(action)
        if not self.progress.must_stand() and not self._cancelling:
            self._drive(now)

    def _start(self, action: Action) -> None:
        needs_body = {"pick", "drop", "startCharging", "stopCharging"}
        if action.action_type == "waitForTrigger":
            self.progress.set_status(action.action_id, ActionStatus.RUNNING)
            return
        if action.action_type not in needs_body:
            self.progress.set_status(action.action_id, ActionStatus.FINISHED)
            return
        assert self._sensed is not None, "work begins when the body is felt"
        if self._sensed.is_moving or (self._busy is not None and not isinstance(self._busy, Charge)):
            return
        load, station = str(action.parameter("loadId") or "load"), str(action.parameter("stationName") or "")
        commands: dict[str, Command] = {
            "pick": Pick(load=load, station=station),
            "drop": Drop(load=self._load or load, station=station),
            "startCharging": Charge(),
            "stopCharging": Rest(),
        }
        self.progress.set_status(action.action_id, ActionStatus.RUNNING)
        self._begin(commands[action.action_type], action.action_id)

    def _drive(self, now: float) -> None:
        nodes, edges = self.progress.leg(self.map_id)
        if not nodes or (self._busy is not None and not isinstance(self._busy, Drive | Charge)):
            return
        if self._blocked_at is not None and now < self._blocked_at + RETRY:
            return
        self._blocked_at = None
        points = tuple((node.node_position.x, node.node_position.y) for node in nodes if node.node_position is not None)
        backward = edges[0].orientation is not None and abs(edges[0].orientation) > math.pi / 2
        yaw = nodes[-1].node_position.theta if nodes[-1].node_position is not None else None
        command = Drive(points=points, map_id=self.map_id, speed=edges[0].maximum_speed, backward=backward, yaw=yaw)
        if isinstance(self._busy, Drive) and self._busy.points[-1:] == points[-1:]:
            return
        for action in edges[0].actions:
            if action not in self.progress.queue:
                self.progress.queue.append(action)
        self._begin(command)

    # What it says.

    def _publish_connection(self) -> None:
        self._effects.append(Publish(topic=Topic.CONNECTION, message=Connection(connection_state=ConnectionState.ONLINE)))
        self._effects.append(Publish(topic=Topic.FACTSHEET, message=self._factsheet))
        self._published_at = -math.inf

    def _publish_state(self, now: float) -> None:
        """Publish the state if something has changed but the pose and the charge, or if it is time (3.0, 6.6)."""
        state = self.state()
        event = msgspec.structs.replace(state, mobile_robot_position=None, power_supply=_charging_only(state.power_supply))
        if event != self._published or now >= self._published_at + self._interval:
            self._published, self._published_at = event, now
            self._effects.append(Publish(topic=Topic.STATE, message=state))

    def state(self) -> State:
        """The state as the vehicle reports it now."""
        sensed, progress = self._sensed, self.progress
        assert sensed is not None, "a state is reported when the body is felt"
        order = progress.order
        _, edges = progress.leg(self.map_id)
        return State(
            order_id=order.order_id if order is not None else "",
            order_update_id=order.order_update_id if order is not None else 0,
            last_node_id=progress.last_node_id,
            last_node_sequence_id=progress.last_sequence_id,
            node_states=progress.node_states(),
            edge_states=progress.edge_states(),
            driving=sensed.is_moving,
            paused=self._paused,
            new_base_request=len(edges) == 1 and any(not node.released for node in progress.nodes),
            action_states=tuple(progress.states.values()),
            instant_action_states=tuple(self._instant.values()),
            power_supply=PowerSupply(state_of_charge=round(sensed.charge, 1), charging=sensed.is_charging),
            operating_mode=self.mode,
            errors=(*self._own_errors, *self._complaints),
            safety_state=SafetyState(active_emergency_stop=EmergencyStop.NONE, field_violation=False),
            mobile_robot_position=Position(x=sensed.x, y=sensed.y, theta=sensed.yaw, map_id=self.map_id, localized=True),
            loads=(Load(load_id=self._load),) if self._load is not None else (),
            maps=tuple(StoredMap(map_id=map_id, map_version="1", map_status=MapStatus.ENABLED) for map_id in sorted(self._maps)),
        )


def _charging_only(power: PowerSupply) -> PowerSupply:
    return PowerSupply(state_of_charge=0.0, charging=power.charging)
