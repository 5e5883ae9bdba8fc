"""Orders to a vehicle: what it has been told is compared with what is wanted, and the difference is sent."""

from __future__ import annotations

import math

from somrs.adapters.vda5050.control.condition import failure, is_idle, rejection, rejection_words
from somrs.adapters.vda5050.control.exchange import Passed, Send
from somrs.adapters.vda5050.control.listener import Listener
from somrs.adapters.vda5050.control.orders import SentOrder, base_end, told_base_end
from somrs.adapters.vda5050.control.outbox import RESEND, UNHEEDED, Outbox
from somrs.adapters.vda5050.messages.header import Topic
from somrs.adapters.vda5050.messages.orders import Action
from somrs.adapters.vda5050.messages.states import ActionStatus, State
from somrs.devices.road_robot import Way, Waypoint

CLEARED = 2
"""States in a row without its order after which a vehicle has dropped it. The first one may have been written before the order came."""

ASTRAY = 1.0
"""Distance in metres from its way at which a vehicle that has dropped its order is not told the rest of it: it was moved."""


class Driving:
    """`way`: what is wanted. `order`: what the vehicle has been told; None: nothing that still holds."""

    def __init__(self, vehicle: Listener, outbox: Outbox) -> None:
        self._vehicle, self._outbox = vehicle, outbox
        self.way: Way = ()
        self.order: SentOrder | None = None
        self._place: Waypoint | None = None
        self._sending_time = -math.inf
        """When the last order was sent."""
        self.stops_charging = False
        """Whether the vehicle is to be told to stop charging with its next order, because it cannot do so by an instant action."""

    def follow(self, way: Way) -> None:
        self.way = way
        if way:
            passed = self._place.number if self._place is not None else way[0].number
            self._place = next((waypoint for waypoint in way if waypoint.number == passed), way[0])

    def map_ids(self) -> set[str]:
        """The maps of the vehicle on which the way lies."""
        vehicle = self._vehicle
        return {vehicle.frames.frame_at(waypoint.level, vehicle.map_id).map_id for waypoint in self.way}

    def see(self, order: SentOrder, state: State, now: float) -> str | None:
        """Take in what a state says about the order. Returns why the vehicle does not carry it out, if it does not."""
        message = order.message
        if state.order_id == message.order_id:
            if state.order_update_id >= message.order_update_id and not order.is_acknowledged:
                order.is_acknowledged, self.stops_charging = True, False
                self._vehicle.refusals.clear()
            self.see_progress(order, state)
        if not order.is_acknowledged and not self._has_lost(order, state):
            error = rejection(state, message.order_id, message.order_update_id, order.earlier_errors)
            reason = str(error) if error is not None else self._silent_refusal(order, state)
            if reason is not None:
                self._vehicle.refusals.add(reason, state, now)
            return reason
        if (reason := self._strange_base(order, state)) is not None:
            return reason
        if self._waits_for_retry(order, state):
            order.earlier_errors = state.errors
        elif (error := failure(state, order.earlier_errors)) is not None:
            return str(error)
        order.cleared = order.cleared + 1 if self._has_dropped(order, state) else 0
        if order.cleared < CLEARED or not is_idle(state) or order.action_id is not None or self._vehicle.hindrance is not None:
            return None
        self.order = None
        return "was moved away from its way" if self._is_astray(order.passed) else None

    def _has_lost(self, order: SentOrder, state: State) -> bool:
        """Whether the vehicle cannot take an update, because it does not know the order any more: it was switched off."""
        return order.message.order_update_id > 0 and state.order_id != order.message.order_id

    def _silent_refusal(self, order: SentOrder, state: State) -> str | None:
        """Why a vehicle that says how it is, and not that it has the order, does not get it again and again."""
        if order.sendings < UNHEEDED:
            return None
        return ": ".join(["does not show that it has its order", *rejection_words(state)])

    def _strange_base(self, order: SentOrder, state: State) -> str | None:
        """Why a vehicle that has the order is not to go on with it: it would drive farther than it may, or does not take more of it."""
        number = told_base_end(order, state)
        if number is not None and number > order.decision_point.number:
            return f"says that {order.nodes[number].node_id} is released, which it is not"
        if number is not None and order.sendings >= UNHEEDED:
            return f"says that its order is released to {order.nodes[number].node_id} only"
        return None

    def _waits_for_retry(self, order: SentOrder, state: State) -> bool:
        """Whether the action of the order has failed, and may be tried again."""
        action = state.action(order.action_id) if order.action_id is not None else None
        return action is not None and action.action_status is ActionStatus.RETRIABLE

    def see_progress(self, order: SentOrder, state: State) -> None:
        """Take in which waypoint the vehicle has passed."""
        number = order.waypoint_number(state.last_node_sequence_id, state.last_node_id)
        if number is not None and order.passed < number <= order.decision_point.number:
            order.passed = number
            self._place = next((waypoint for waypoint in self.way if waypoint.number == number), self._place)
            self._outbox.add(Passed(number=number))

    @property
    def is_wanted(self) -> bool:
        """Whether there is something to drive, or an order that the vehicle has not carried out."""
        return (bool(self.way) and len(self._rest()) > 1) or (self.order is not None and not self.is_complete())

    def is_complete(self) -> bool:
        """Whether the vehicle has carried out all of the order, and has nothing to do."""
        order, state = self.order, self._vehicle.state
        if order is None or state is None or not order.is_acknowledged:
            return False
        return is_idle(state) and order.passed >= order.decision_point.number

    def reconcile(self, now: float) -> None:
        """Send what is wanted and has not been said. Nothing while the vehicle has not shown that it knows the last message: an update
        that continues a lost one is rejected."""
        state, order = self._vehicle.state, self.order
        if state is None or not self.way or (order is not None and (not order.is_acknowledged or order.action_id is not None)):
            return
        if self._is_too_soon(now) or (order is not None and order.cleared):
            return
        if order is not None and self.is_complete() and base_end(self.way).number > order.decision_point.number:
            order = self.order = None
        if order is not None:
            self._extend(order, state, now)
        elif is_idle(state) and base_end(rest := self._rest()) is not rest[0]:  # nobody has to be told to stay where it is
            self._send_order(rest, now)

    def perform(self, action: Action, now: float) -> None:
        """Send an action in an order of its own, at the place of the vehicle; at first an end to the order that it has."""
        state, order = self._vehicle.state, self.order
        if state is None or self._is_too_soon(now) or (order is not None and not order.is_acknowledged):
            return
        if order is not None and order.horizon:
            self._update(order, (order.decision_point,), now)
        elif is_idle(state) and (order is None or self.is_complete()):
            self._send_order((self._here(state),), now, action)

    def resend(self, order: SentOrder, now: float) -> None:
        """Send the last message again, as it was: a vehicle that knows it ignores it (3.0, 6.1.4.5)."""
        order.sendings += self._vehicle.is_heard(now)
        order.sending_time = self._sending_time = now
        self._outbox.add(Send(topic=Topic.ORDER, message=order.message))

    def _is_too_soon(self, now: float) -> bool:
        """Whether the vehicle does not take another order yet (2.1, 6.14; 3.0, 7.10: minimumOrderInterval)."""
        return now < self._sending_time + self._vehicle.order_interval()

    def _has_dropped(self, order: SentOrder, state: State) -> bool:
        """Whether the vehicle has another order or none, although it has not come to the end of this one."""
        if state.order_id != order.message.order_id:
            return True
        return is_idle(state) and order.passed < order.decision_point.number

    def _is_astray(self, passed: int) -> bool:
        pose = self._vehicle.pose
        stretch = [waypoint for waypoint in self.way if passed <= waypoint.number <= passed + 1]
        if pose is None or not stretch:
            return False
        start, end = stretch[0], stretch[-1]
        dx, dy = end.x - start.x, end.y - start.y
        share = ((pose.x - start.x) * dx + (pose.y - start.y) * dy) / (dx * dx + dy * dy) if (dx, dy) != (0.0, 0.0) else 0.0
        share = min(max(share, 0.0), 1.0)
        return math.hypot(pose.x - start.x - share * dx, pose.y - start.y - share * dy) > ASTRAY

    def _rest(self) -> Way:
        """The way from the last waypoint that the vehicle has passed."""
        passed = self._place.number if self._place is not None else self.way[0].number
        passed = min(passed, base_end(self.way).number)
        return tuple(waypoint for waypoint in self.way if waypoint.number >= passed)

    def _here(self, state: State) -> Waypoint:
        if self._place is not None:
            return self._place
        pose = self._vehicle.pose
        x, y, level = (pose.x, pose.y, pose.level or 0.0) if pose is not None else (0.0, 0.0, 0.0)
        return Waypoint(number=0, name=state.last_node_id or "Here", x=x, y=y, level=level, released=True)

    def _send_order(self, way: Way, now: float, action: Action | None = None) -> None:
        state, vehicle = self._vehicle.state, self._vehicle
        assert state is not None, "orders are for vehicles that have said how they are"
        way = way[: vehicle.most_nodes()]
        writer = vehicle.order_writer()
        actions = [action] if action is not None else []
        if self.stops_charging:
            actions.insert(0, self._outbox.action("stopCharging", vehicle.blocking_type("stopCharging")))
        message = writer.new_order(self._outbox.new_id(), way, tuple(actions))
        end = base_end(way)
        self.order = SentOrder(
            message=message,
            first=way[0].number,
            decision_point=end,
            horizon=tuple(waypoint for waypoint in way if waypoint.number > end.number),
            sending_time=now,
            passed=way[0].number,
            action_id=action.action_id if action is not None else None,
            earlier_errors=state.errors,
        )
        self.order.remember()
        self._sending_time = now
        self._outbox.add(Send(topic=Topic.ORDER, message=message))

    def _extend(self, order: SentOrder, state: State, now: float) -> None:
        end = self._base_end(order, state)
        if end is not order.decision_point and now < order.sending_time + RESEND:
            return  # it may not have said all yet
        way = (end, *(waypoint for waypoint in self.way if waypoint.number > end.number))[: self._vehicle.most_nodes()]
        if end.number >= self.way[0].number and way[1:] != order.horizon:
            self._update(order, way, now)

    def _base_end(self, order: SentOrder, state: State) -> Waypoint:
        """Where the base ends by what the vehicle says of it: it rejects an update that begins behind that."""
        number = told_base_end(order, state)
        return next((waypoint for waypoint in self.way if waypoint.number == number), order.decision_point)

    def _update(self, order: SentOrder, way: Way, now: float) -> None:
        """Send an update that begins at the decision point (3.0, 6.1.2)."""
        state, vehicle = self._vehicle.state, self._vehicle
        assert state is not None, "orders are for vehicles that have said how they are"
        is_repetition = base_end(way).number <= order.decision_point.number and way[0] is not order.decision_point
        writer = vehicle.order_writer()
        order.message = writer.update(order, way)
        order.decision_point, order.sending_time, order.is_acknowledged = base_end(way), now, False
        order.sendings = order.sendings + 1 if is_repetition else 0
        order.horizon = tuple(waypoint for waypoint in way if waypoint.number > order.decision_point.number)
        order.earlier_errors = state.errors
        order.remember()
        self._sending_time = now
        self._outbox.add(Send(topic=Topic.ORDER, message=order.message))
