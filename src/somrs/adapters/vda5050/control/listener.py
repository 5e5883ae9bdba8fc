"""What a vehicle has said of itself so far, and what that means for those who want something from it."""

from __future__ import annotations

import math
import re

import msgspec

from somrs.adapters.vda5050.control.condition import IN_CONTROL, delay, hindrance, remark, warnings
from somrs.adapters.vda5050.control.exchange import (
    Arrived,
    Broken,
    Charged,
    Delayed,
    Loaded,
    Located,
    Reachable,
    Refused,
    Remarked,
    Tolerated,
    Warned,
)
from somrs.adapters.vda5050.control.headers import HeaderLog
from somrs.adapters.vda5050.control.novelty import Novelty
from somrs.adapters.vda5050.control.orders import OPTIONAL, SENT, USEFUL, OrderWriter
from somrs.adapters.vda5050.control.outbox import RESEND, Outbox
from somrs.adapters.vda5050.control.refusals import Refusals
from somrs.adapters.vda5050.frames import Frames, Pose
from somrs.adapters.vda5050.messages.factsheets import Factsheet, StringLengths
from somrs.adapters.vda5050.messages.header import Version, seconds_of
from somrs.adapters.vda5050.messages.orders import BlockingType
from somrs.adapters.vda5050.messages.states import (
    Connection,
    ConnectionState,
    EmergencyStop,
    ErrorLevel,
    OperatingMode,
    Position,
    PowerSupply,
    SafetyState,
    State,
    Visualization,
)
from somrs.adapters.vda5050.stations import unmet_parameters

NUMBERS = re.compile(r"\d+")
"""What differs between two states in which a vehicle says the same."""

SILENCE = 30.0
"""Seconds after which a vehicle has to send a state, whatever happens (2.1, 6.10; 3.0, 6.6)."""

DISOBEDIENT = "goes on with an order that it was told to cancel"

QUIET = f"has sent no state that can be read for {SILENCE:.0f} s"

LONGEST_INTERVAL = 10.0
"""Seconds between two orders that a vehicle may ask for: more is a number of milliseconds."""
FARTHEST = 1e8
"""A coordinate on a map is less than that, m: none on Earth is more."""

FULL = 99.0
"""The state of charge at which the battery of a vehicle is full whose factsheet does not say it."""
LARGEST = 100.0
"""How far vehicles extend around their middle, at most, m."""
REACH = 0.5
"""How far a vehicle extends around its middle whose factsheet does not say it, m."""


class Listener:
    """`version`: in which the vehicle speaks, as far as it has said so."""

    def __init__(self, frames: Frames, version: Version, outbox: Outbox) -> None:
        self.frames, self.version, self._outbox = frames, version, outbox
        self.headers = HeaderLog()
        self.state: State | None = None
        self.factsheet: Factsheet | None = None
        self.pose: Pose | None = None
        self.map_id = ""
        self.is_connected = False
        self.absence: str | None = None
        """Why it cannot be reached, as far as it is known."""
        self.hindrance: str | None = None
        """Why the vehicle cannot drive; None if it can."""
        self.delay: str | None = None
        """What keeps the vehicle from going on, and will pass; None: nothing."""
        self.clock_lead = 0.0
        """By how many seconds its clock is ahead of that of this program."""
        self.was_heard = False
        """Whether it has said anything since the broker is there."""
        self.is_outdated = False
        """Whether it has said that it is there, and not yet how it is now."""
        self.is_hibernating = False
        """Whether it has said that it hibernates: it sends no states, and takes nothing but the order to wake up."""
        self._hibernation_time = 0.0
        self._is_disobedient = False
        self.refusals = Refusals()
        self._state_time: float | None = None
        """When its last state came, or it has been waited for since."""
        self._is_silent = False
        self._tolerated = Novelty()
        self._examined: Factsheet | None = None
        self._cancelled_order = ""
        self.remark: str | None = None
        """What else it says of itself; None: nothing."""

    def hear(self, arrived: Arrived, now: float) -> State | None:
        """Take in a message. Returns the state, if it is a new one."""
        received = arrived.received
        self.was_heard = True
        for deviation in received.deviations:
            self._tolerate(deviation)
        if isinstance(received.message, Connection) and received.message.connection_state is ConnectionState.ONLINE:
            self.headers.connect(received.header)
        if self.headers.is_old(arrived.topic, received.header, now):
            return None
        if version := received.header.version:
            self.version = Version.closest(version, self.version.major)
            if version.partition(".")[0] != str(self.version.major):
                self._tolerate(f"version is {version!r} at topics of v{self.version.major}")
        match received.message:
            case Connection(connection_state=connection_state):
                self._hear_connection(connection_state, now)
            case Factsheet() as factsheet:
                self.factsheet = factsheet
                self._outbox.limits = self.limits
                self._name_unmet_needs(factsheet)
                if self.state is not None:
                    self._outbox.add(Charged(level=self.charge(self.state)))
            case Visualization(mobile_robot_position=Position() as position):
                self._locate(position)
            case State() as state:
                moment = seconds_of(received.header.timestamp)
                self.clock_lead = moment - now if moment is not None else 0.0
                self._state_time, self.is_outdated = now, False
                self.is_hibernating = self.is_hibernating and now < self._hibernation_time + RESEND  # it was sent just before
                self._reach()
                self._hear_state(state := self._without_cancelled(state), now)
                return state
        return None

    def silence(self, now: float) -> float:
        """For how many seconds a vehicle that is there has sent no state that can be read."""
        return now - self._state_time if self.is_connected and self._state_time is not None else 0.0

    def is_heard(self, now: float) -> bool:
        """Whether the vehicle says how it is, so that a message that it does not show is not lost with all others."""
        return self.is_connected and self.silence(now) < RESEND

    def notice_time(self, now: float) -> None:
        """Time has passed, in which the vehicle may have sent nothing."""
        if self._state_time is None or not self.is_connected or self.is_hibernating:
            self._state_time = now
        self.refusals.review(self.state, now)
        self.judge()
        self._judge_delay(now)

    def assume_idle(self) -> None:
        """Take the vehicle for one without an order, although it does not say so; or for one whose order is as it was."""
        self.is_outdated = False
        if self.state is not None:
            return
        self._tolerate("state: is not sent before the vehicle has an order")
        self.state = State(
            order_id="",
            order_update_id=0,
            last_node_id="",
            last_node_sequence_id=0,
            node_states=(),
            edge_states=(),
            driving=False,
            action_states=(),
            instant_action_states=(),
            power_supply=PowerSupply(state_of_charge=100.0, charging=False),
            operating_mode=OperatingMode.AUTOMATIC,
            errors=(),
            safety_state=SafetyState(active_emergency_stop=EmergencyStop.NONE, field_violation=False),
        )

    def _tolerate(self, deviation: str) -> None:
        if self._tolerated.is_new(deviation):
            self._outbox.add(Tolerated(deviation=deviation))

    def charge(self, state: State) -> float:
        """The charge in percent of that to which the battery is charged: a battery that is charged no further is full."""
        return round(max(0.0, min(100.0, 100.0 * state.power_supply.state_of_charge / self.full_charge())), 1)

    def full_charge(self) -> float:
        """The state of charge to which the battery is charged, 0 to 100."""
        level = self.factsheet.charging.maximum_desired_charging_level if self.factsheet is not None else None
        return level if level is not None and 0.0 < level <= 100.0 else FULL

    def charging_time(self) -> float:
        """For how long the vehicle charges at least, also when its battery is full, if nothing else is wanted from it, s."""
        return (self.factsheet.charging.minimum_charging_time if self.factsheet is not None else None) or 0.0

    def order_writer(self) -> OrderWriter:
        """Writes orders for the vehicle as it is now."""
        return OrderWriter(frames=self.frames, map_id=self.map_id, pose=self.pose, parameters=self.optional_parameters, limits=self.limits)

    def _name_unmet_needs(self, factsheet: Factsheet) -> None:
        """Name the optional parameters of orders that the vehicle requires, and that are not sent."""
        required = [item.parameter for item in factsheet.protocol_features.optional_parameters if item.support == "REQUIRED"]
        unmet = [name for name in required if name.startswith("order") and name.rpartition(".")[2] not in SENT]
        unmet += unmet_parameters(factsheet)
        if unmet and factsheet != self._examined:
            self._outbox.add(Refused(description=f"requires {', '.join(unmet)}, which fleet control does not send"))
        self._examined = factsheet

    @property
    def limits(self) -> StringLengths | None:
        """The limits of its identifiers, as far as it has said so."""
        return self.factsheet.protocol_limits.maximum_string_lengths if self.factsheet is not None else None

    @property
    def optional_parameters(self) -> frozenset[str]:
        """The optional parameters of orders that are sent to the vehicle. In 2.x, an empty list was not always meant."""
        if self.factsheet is None or (self.version.major == 2 and not self.factsheet.protocol_features.optional_parameters):
            return USEFUL
        return frozenset(parameter for parameter in OPTIONAL if self.factsheet.takes(parameter))

    def can_perform(self, action_type: str) -> bool:
        """Whether it has an action, as far as the factsheet says it."""
        return self.factsheet is None or self.factsheet.action(action_type) is not None

    def scopes(self, action_type: str) -> set[str]:
        """Where an action may be used, as far as the factsheet says it."""
        supported = self.factsheet.action(action_type) if self.factsheet is not None else None
        return set(supported.action_scopes) if supported is not None else set()

    def blocking_type(self, action_type: str) -> BlockingType:
        """What an action of the vehicle excludes: everything, if the vehicle can do that."""
        supported = self.factsheet.action(action_type) if self.factsheet is not None else None
        words = supported.blocking_types if supported is not None else None
        order = (BlockingType.HARD, BlockingType.SOFT, BlockingType.SINGLE, BlockingType.NONE)
        return next((blocking for blocking in order if words and blocking.value in words), BlockingType.HARD)

    @property
    def reach(self) -> float:
        """How far it extends around its middle, m; with its load, as far as the factsheet says it."""
        if self.factsheet is None:
            return REACH
        physical = self.factsheet.physical_parameters
        reach = math.hypot(physical.length, physical.width) / 2
        return reach if 0.0 < reach < LARGEST else REACH

    def order_interval(self) -> float:
        """Seconds that have to pass between two orders."""
        interval = self.factsheet.protocol_limits.timing.minimum_order_interval if self.factsheet is not None else 0.0
        return min(interval, LONGEST_INTERVAL)

    def most_nodes(self) -> int | None:
        """How many nodes an order may have, two at least; None: any number."""
        if self.factsheet is None:
            return None
        lengths = self.factsheet.protocol_limits.maximum_array_lengths
        limits = [lengths.order_nodes or None, lengths.order_edges + 1 if lengths.order_edges else None]
        return max(2, min((limit for limit in limits if limit is not None), default=0)) if any(limits) else None

    def _hear_connection(self, connection_state: ConnectionState, now: float) -> None:
        self.is_hibernating = connection_state is ConnectionState.HIBERNATING
        if self.is_hibernating:
            self._hibernation_time = now
            self._reach()
        elif connection_state is ConnectionState.ONLINE:
            if self.state is None:
                self._reach()
            self.refusals.clear()
            if self.takes_instant_actions:
                self.is_outdated = True  # until it answers, nobody knows what it has done meanwhile
                self._outbox.instant("stateRequest")
        else:
            self.lose(f"its connection is {connection_state.value}")
        self._judge_delay(now)

    @property
    def takes_instant_actions(self) -> bool:
        """Whether instant actions may be sent, as far as its last state says (3.0, table 11)."""
        return not self.is_hibernating and (self.state is None or self.state.operating_mode in IN_CONTROL)

    @property
    def takes_orders(self) -> bool:
        """Whether orders may be sent: it is there, awake, can drive, and has said how it is since it is there."""
        return self.is_connected and self.hindrance is None and not self.is_outdated and not self.is_hibernating

    def lose(self, absence: str) -> None:
        """The vehicle cannot be reached, for this reason."""
        self.is_outdated = self.is_hibernating = False
        if self.is_connected or absence != self.absence:
            self.is_connected, self.absence = False, absence
            self._outbox.add(Reachable(is_connected=False))

    def _reach(self) -> None:
        """A state proves more than a connection message: the last will of a lost connection may come after the vehicle is back."""
        if not self.is_connected:
            self.is_connected = True
            self._say_reachable()
            if self.factsheet is None and self.takes_instant_actions:
                self._outbox.instant("factsheetRequest")

    @property
    def is_commanded(self) -> bool:
        """Whether the vehicle is there, and heeds what it is told."""
        return self.is_connected and not self._is_disobedient

    def disobeys(self, is_disobedient: bool) -> None:
        """Whether the vehicle goes on with what it was told to end. It counts as one that cannot be reached: nobody knows how far it
        drives."""
        if is_disobedient is self._is_disobedient:
            return
        self._is_disobedient = is_disobedient
        if is_disobedient:
            self._outbox.add(Refused(description=DISOBEDIENT))
        if self.is_connected:
            self._say_reachable()

    def _say_reachable(self) -> None:
        self.absence = DISOBEDIENT if self._is_disobedient else None
        self._outbox.add(Reachable(is_connected=self.is_commanded))

    def _locate(self, position: Position) -> None:
        if max(abs(position.x), abs(position.y)) > FARTHEST:
            self._tolerate("state: is at a point that is on no map")
            return
        self.map_id = position.map_id
        if position.localized and self.frames.has(position.map_id):
            self.pose = self.frames.frame(position.map_id).to_site(position.x, position.y, position.theta)
            self._outbox.add(Located(pose=self.pose))

    def note_cancelled(self, order_id: str) -> None:
        """The vehicle says that this order is cancelled. Some go on to list its nodes."""
        self._cancelled_order = order_id
        if self.state is not None:
            self.state = self._without_cancelled(self.state)

    def _without_cancelled(self, state: State) -> State:
        """A state without the nodes of an order that was cancelled, of a vehicle that stands."""
        if not state.order_id or state.order_id != self._cancelled_order or state.driving or not (state.node_states or state.edge_states):
            return state
        self._tolerate("state: lists nodes of an order that was cancelled")
        return msgspec.structs.replace(state, node_states=(), edge_states=())

    def _hear_state(self, state: State, now: float) -> None:
        previous, self.state = self.state, state
        if state.operating_mode is not OperatingMode.STARTUP:  # what else it says may not be valid then (3.0, table 10)
            self._hear_body(state, previous)
        self.refusals.review(state, now)
        self.judge()
        self._judge_delay(now)
        earlier_words = {NUMBERS.sub("#", str(error)) for error in warnings(previous)} if previous is not None else set()
        for error in warnings(state):
            if NUMBERS.sub("#", str(error)) not in earlier_words:
                self._outbox.add(Warned(description=str(error), is_urgent=error.error_level is ErrorLevel.URGENT))
        if (words := remark(state)) != self.remark:
            self.remark = words
            self._outbox.add(Remarked(text=words))

    def judge(self) -> None:
        """Find out whether the vehicle can be sent orders."""
        if self.state is None:
            return
        reasons = [hindrance(self.state), self.headers.doubt, self._foreign_map(self.state), self.refusals.reason]
        reason = "; ".join(reason for reason in reasons if reason is not None) or None
        if reason != self.hindrance:
            self.hindrance = reason
            self._outbox.add(Broken(reason=reason))

    def _foreign_map(self, state: State) -> str | None:
        position = state.mobile_robot_position
        if position is None or self.frames.has(position.map_id):
            return None
        map_ids = ", ".join(frame.map_id for frame in self.frames.all)
        return f"is on the map {position.map_id}, and the site has only {map_ids}: give its `level` under `maps` in the settings"

    def _judge_delay(self, now: float) -> None:
        reasons = [words] if self.state is not None and (words := delay(self.state)) is not None else []
        if self.is_hibernating:
            reasons.append("hibernates")
        is_silent = self.silence(now) >= SILENCE + RESEND and not self.is_hibernating
        if is_silent:
            reasons.append(QUIET)
            if not self._is_silent:
                self._outbox.add(Refused(description=QUIET))
        self._is_silent = is_silent
        reason = "; ".join(reasons) or None
        if reason != self.delay:
            self.delay = reason
            self._outbox.add(Delayed(reason=reason))

    def _hear_body(self, state: State, previous: State | None) -> None:
        if state.loads is not None and (previous is None or previous.loads is None or len(previous.loads) != len(state.loads)):
            self._outbox.add(Loaded(count=len(state.loads)))
        if state.mobile_robot_position is not None:
            self._locate(state.mobile_robot_position)
        if previous is None or previous.power_supply.state_of_charge != state.power_supply.state_of_charge:
            self._outbox.add(Charged(level=self.charge(state)))
