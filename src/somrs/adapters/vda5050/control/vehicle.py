"""Fleet control of one vehicle: `VehicleControl.handle` takes what arrives, what is wanted and the time, and returns what to do.

What is wanted (a way, or an action) is compared with what the vehicle has been told, whenever something happens, and the difference is
sent. So a message that is lost, a vehicle that restarts, and one that was driven by hand need nothing of their own.
"""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from somrs.adapters.vda5050.control.cancelling import Cancelling
from somrs.adapters.vda5050.control.condition import CLEARING, is_idle, words_about
from somrs.adapters.vda5050.control.driving import Driving
from somrs.adapters.vda5050.control.exchange import (
    ActionEnded,
    Arrived,
    BuildingChanged,
    Charge,
    Disconnected,
    Effect,
    Follow,
    GaveUp,
    Halt,
    Halted,
    Input,
    Pause,
    Perform,
    Refused,
    Resume,
    Subscribed,
    Tick,
)
from somrs.adapters.vda5050.control.hibernation import Hibernation
from somrs.adapters.vda5050.control.inquiry import Inquiry
from somrs.adapters.vda5050.control.job import Charging, Job
from somrs.adapters.vda5050.control.listener import Listener
from somrs.adapters.vda5050.control.orders import SentOrder
from somrs.adapters.vda5050.control.outbox import RESEND, UNHEEDED, Outbox
from somrs.adapters.vda5050.control.pausing import Pausing
from somrs.adapters.vda5050.control.policy import Policy
from somrs.adapters.vda5050.control.provision import Provision
from somrs.adapters.vda5050.control.requests import Requests
from somrs.adapters.vda5050.control.retrying import Retrying
from somrs.adapters.vda5050.frames import Frames
from somrs.adapters.vda5050.messages.header import Version
from somrs.adapters.vda5050.messages.orders import ActionParameter, BlockingType
from somrs.adapters.vda5050.messages.states import ActionStatus, State
from somrs.adapters.vda5050.zoning.sets import impossible_actions, zone_set
from somrs.adapters.vda5050.zoning.site import SiteZone


class VehicleControl:
    """`version`: in which the vehicle speaks, as far as it has said so. `new_id`: makes identifiers that are never used again.
    `policy`: what the site wants of it."""

    def __init__(self, frames: Frames, version: Version, new_id: Callable[[], str], policy: Policy | None = None) -> None:
        self._policy = policy if policy is not None else Policy()
        self._outbox = Outbox(new_id)
        self.vehicle = Listener(frames, version, self._outbox)
        self._driving = Driving(self.vehicle, self._outbox)
        self._cancelling = Cancelling(self.vehicle, self._outbox, self._driving)
        self._job: Job | None = None
        self._charging: Charging | None = None
        self._pausing = Pausing(self._outbox)
        self._inquiry = Inquiry(self.vehicle, self._outbox)
        self._hibernation = Hibernation(self.vehicle, self._outbox, self._policy.hibernate_after)
        self._provision, self._requests = Provision(self.vehicle, self._outbox), Requests(self.vehicle, self._outbox)
        self._provision.packages = self._policy.packages
        self._zones: tuple[SiteZone, ...] | None = None
        self._zones_key: object = None

    def handle(self, input: Input, now: float) -> list[Effect]:
        """Take in what happened. Returns what to do, in this order."""
        self._outbox.effects = []
        match input:
            case Arrived():
                state = self.vehicle.hear(input, now)
                if state is not None:
                    self._see(state, now)
            case Subscribed():
                self._inquiry.begin()
            case Disconnected():
                self.vehicle.lose("its broker is not there")
            case Follow(way=way):
                self._driving.follow(way)
            case Halt():
                self._halt(now)
            case Pause() | Resume():
                self._pausing.is_wanted = isinstance(input, Pause)
            case Perform() | Charge() if self.vehicle.hindrance is not None:
                self._outbox.add(ActionEnded(failure=self.vehicle.hindrance))
            case Perform(action_type=action_type, parameters=parameters):
                self._driving.way = ()
                self._job = self._new_job(action_type, parameters)
            case Charge():
                self._driving.way = ()
                self._job = self._new_job("startCharging")
            case BuildingChanged(zones=zones):
                self._zones = zones
            case Tick():
                self.vehicle.notice_time(now)
                self._repeat(now)
        self._hibernation.reconcile(now, is_wanted=self._is_wanted)
        self._reconcile(now)
        return self._outbox.effects

    @property
    def _is_wanted(self) -> bool:
        """Whether the vehicle has something to do."""
        work = self._job, self._charging, self._cancelling.current
        return any(item is not None for item in work) or self._pausing.is_wanted or self._driving.is_wanted

    def _new_job(self, action_type: str, parameters: tuple[ActionParameter, ...] = ()) -> Job:
        """An action at a node; or an instant one, to charge, for a vehicle that cannot do so at nodes."""
        charges = action_type == "startCharging"
        is_instant = charges and self.vehicle.scopes(action_type) == {"INSTANT"}
        blocking = BlockingType.NONE if is_instant else self.vehicle.blocking_type(action_type)
        action = self._outbox.action(action_type, blocking, parameters)
        if self._policy.retries and self.vehicle.version is Version.V3_0 and "retriable" in self.vehicle.optional_parameters:
            action = msgspec.structs.replace(action, retriable=True)
        retrying = Retrying(self.vehicle, self._outbox, action.action_id, self._policy.retries)
        return Job(action=action, retrying=retrying, charges=charges, is_instant=is_instant)

    def _see(self, state: State, now: float) -> None:
        if self.vehicle.hindrance is not None:
            self._give_up(self.vehicle.hindrance, state, now)
        order = self._driving.order
        if self._cancelling.current is not None:
            self._cancelling.see(self._cancelling.current, state, now)
        elif order is not None:
            self._see_order(order, state, now)
        elif self._job is not None and self._job.sending_time is not None:
            self._see_action(self._job, state, now)
        elif self._charging is None and self.vehicle.hindrance is None and self._cancelling.is_due(state, now):
            self._cancelling.begin(now)
        self._cancelling.review(state)
        if self._charging is not None:
            self._see_charging(self._charging, state, now)
        if self.vehicle.hindrance is None and not state.paused:  # those of a pause say who has begun it
            self._outbox.clear("clearInstantActions", state, state.instant_action_states)
            if self.vehicle.can_perform("clearZoneActions"):
                self._outbox.clear("clearZoneActions", state, state.zone_action_states or ())

    def _give_up(self, hindrance: str, state: State, now: float) -> None:
        """Drop what is wanted from a vehicle that cannot drive: it would go on by itself, when somebody has mended it."""
        self._driving.way = ()
        if self._job is not None or self._charging is not None:
            self._job = self._charging = None
            self._outbox.add(ActionEnded(failure=hindrance))
        if state.operating_mode in CLEARING:
            cancellation = self._cancelling.current
            effects = cancellation.effects if cancellation is not None and not state.driving else []
            if effects or cancellation is None:
                self._cancelling.current, self._driving.order = None, None
            self._outbox.add(*effects)
        elif self._cancelling.current is None and self._driving.order is not None:
            if self._driving.is_complete():
                self._driving.order = None
            else:
                self._cancelling.begin(now)

    def _see_order(self, order: SentOrder, state: State, now: float) -> None:
        reason = self._driving.see(order, state, now)
        if reason is not None:
            self._fail(order, reason, state, now)
            self.vehicle.judge()
        elif order.is_acknowledged and order.action_id is not None and self._job is not None:
            if state.order_id != order.message.order_id:
                self._end_job("the vehicle has lost the order")
            else:
                self._see_action(self._job, state, now)

    def _fail(self, order: SentOrder, reason: str, state: State, now: float) -> None:
        """End the trip or the action, when the vehicle stands."""
        is_action = order.action_id is not None and self._job is not None
        effect: Effect = ActionEnded(failure=reason) if is_action else GaveUp(description=reason)
        self._job, self._driving.way = None, ()
        has_no_order = self._driving.order is None or state.order_id != order.message.order_id
        if has_no_order and is_idle(state):
            self._driving.order = None
            self._outbox.add(effect)
        else:
            self._cancelling.begin(now, effect)

    def _see_action(self, job: Job, state: State, now: float) -> None:
        action = state.action(job.action.action_id)
        if action is None:
            self._see_nothing(job, state, now)
            return
        job.unlisted = 0
        if action.action_status is ActionStatus.FAILED:
            self._end_job(words_about(state, action.action_id, job.retrying.reason))
        elif action.action_status is ActionStatus.RETRIABLE:
            self._retry(job, state, now)
        elif action.action_status is ActionStatus.FINISHED and job.charges:
            self._job, self._driving.order = None, None
            self._charging = Charging(full=self.vehicle.full_charge(), start_time=now, least_end=now + self.vehicle.charging_time())
        elif action.action_status is ActionStatus.FINISHED and is_idle(state):
            self._end_job(None)

    def _see_nothing(self, job: Job, state: State, now: float) -> None:
        """The vehicle does not list the action. It may have dropped it; whether it has performed it, nobody knows then."""
        order = self._driving.order
        job.unlisted += 1
        if order is not None and job.unlisted >= UNHEEDED and is_idle(state) and now >= order.sending_time + RESEND:
            self._end_job(f"the vehicle does not say what has become of {job.action.action_type}")

    def _retry(self, job: Job, state: State, now: float) -> None:
        """Have the vehicle try the action again, or give it up."""
        if not job.retrying.reconcile(state, now):
            return
        reason = job.retrying.reason or "the action has failed"
        if self._driving.order is not None:
            self._fail(self._driving.order, reason, state, now)
        else:
            self._end_job(reason)

    def _end_job(self, reason: str | None) -> None:
        self._job, self._driving.order = None, None
        self._outbox.add(ActionEnded(failure=reason))

    def _see_charging(self, charging: Charging, state: State, now: float) -> None:
        power = state.power_supply
        charging.has_charged = charging.has_charged or power.charging
        is_full = power.state_of_charge >= charging.full and now >= charging.least_end
        if power.charging and is_full and charging.stop_id is None and self._stops_by_order():
            charging.is_left = True
        elif power.charging and is_full and charging.stop_id is None:
            self._stop_charging(charging, now)
        if not charging.is_over(state, now):
            return
        self._charging = None
        if charging.is_interrupted:
            self._outbox.add(Halted())
        elif charging.stop_id is None and power.state_of_charge < charging.full - 5.0:
            words = "stopped charging" if charging.has_charged else "does not charge, and is"
            self._outbox.add(ActionEnded(failure=f"the vehicle {words} at {power.state_of_charge:.0f} %"))
        else:
            self._outbox.add(ActionEnded(failure=None))

    def _stops_by_order(self) -> bool:
        """Whether the vehicle stops charging by an action of an order only. The next one has it."""
        self._driving.stops_charging = self.vehicle.scopes("stopCharging") == {"NODE"}
        return self._driving.stops_charging

    def _stop_charging(self, charging: Charging, now: float) -> None:
        charging.sendings += charging.stop_id is not None and self.vehicle.is_heard(now)
        charging.stop_id, charging.sending_time = self._outbox.instant("stopCharging"), now

    # Halting (3.0, 6.1.3).

    def _halt(self, now: float) -> None:
        state, driving = self.vehicle.state, self._driving
        if self._job is not None and self._job.sending_time is not None:
            self._charging = Charging(full=self.vehicle.full_charge(), start_time=now)  # it may have begun
        driving.way, self._job = (), None
        if self._charging is not None:
            self._charging.is_interrupted = True
            if self._stops_by_order():
                self._charging = None
                self._outbox.add(Halted())
            elif self._charging.stop_id is None:
                self._stop_charging(self._charging, now)
        elif self._cancelling.current is not None:
            self._cancelling.current.effects.append(Halted())
        elif state is None or driving.is_complete() or (driving.order is None and is_idle(state)):
            driving.order = None
            self._outbox.add(Halted())
        else:
            self._cancelling.begin(now, Halted())

    # What the vehicle is told.

    def _reconcile(self, now: float) -> None:
        if not self.vehicle.takes_orders:
            return
        state = self.vehicle.state
        if state is not None:
            self._pausing.reconcile(state, now)
            self._renew_zone_sets()
            self._provision.reconcile(state, now)
            self._requests.answer(state, self._driving.way, now)
        if self._cancelling.current is not None or self._charging is not None or self._pausing.is_wanted:
            return
        if state is not None and self._hibernation.is_falling_asleep(state, now):
            return
        if self._job is None:
            if not self._lacks_map(now):
                self._driving.reconcile(now)
        elif self._job.is_instant:
            self._begin_at_once(self._job, now)
        elif self._driving.order is None or self._driving.order.action_id != self._job.action.action_id:
            self._driving.perform(self._job.action, now)

    def _begin_at_once(self, job: Job, now: float) -> None:
        """Send the instant action of a job when the vehicle has nothing else to do; again if it is lost."""
        state, driving = self.vehicle.state, self._driving
        if state is None or not is_idle(state) or (driving.order is not None and not driving.is_complete()):
            return
        driving.order = None
        is_lost = job.sending_time is not None and now >= job.sending_time + RESEND and state.action(job.action.action_id) is None
        if is_lost and job.sendings >= UNHEEDED:
            self._end_job(f"the vehicle does not show that it has {job.action.action_type}")
        elif job.sending_time is None or is_lost:
            job.sendings += self.vehicle.is_heard(now)
            job.sending_time = now
            self._outbox.send_action(job.action)

    def _lacks_map(self, now: float) -> bool:
        """Give the trip up if it leads to a map that the vehicle does not have: it would reject the order (3.0, 6.1.4.10)."""
        state, order = self.vehicle.state, self._driving.order
        map_id = self._provision.missing_map(self._driving.map_ids(), state) if state is not None else None
        if state is None or map_id is None:
            return False
        reason = f"it has no map {map_id} that is enabled"
        if order is not None:
            self._fail(order, reason, state, now)
        else:
            self._driving.way = ()
            self._outbox.add(GaveUp(description=reason))
        return True

    def _renew_zone_sets(self) -> None:
        """The zone sets that the vehicle is to have, if it supports zones: one for each of its maps."""
        vehicle = self.vehicle
        key = self._zones, vehicle.factsheet, vehicle.map_id
        if key == self._zones_key or self._zones is None or vehicle.factsheet is None or not vehicle.map_id:
            return
        self._zones_key = key
        if vehicle.version is Version.V3_0 and vehicle.factsheet.type_specification.supported_zones:
            frames = vehicle.frames.all or (vehicle.frames.frame(vehicle.map_id),)
            self._provision.zone_sets = tuple(zone_set(frame, self._zones, vehicle.factsheet) for frame in frames)
            if actions := impossible_actions(self._zones, vehicle.factsheet):
                self._outbox.add(Refused(description=f"does not have {', '.join(actions)}"))
            self._requests.zone_sets |= {zones.zone_set_id: zones for zones in self._provision.zone_sets}

    def _repeat(self, now: float) -> None:
        """Send again what the vehicle does not show to have received."""
        state, order, charging, cancellation = self.vehicle.state, self._driving.order, self._charging, self._cancelling.current
        self._inquiry.ask(now)
        job = self._job
        action = state.action(job.action.action_id) if state is not None and job is not None else None
        if state is None or not self.vehicle.is_connected or self.vehicle.is_hibernating or self._cancelling.clears_orders():
            return
        if cancellation is not None:
            self._cancelling.repeat(cancellation, state, now)
        elif charging is not None and charging.stop_id is not None:
            if now >= charging.sending_time + RESEND and state.action(charging.stop_id) is None:
                self._stop_charging(charging, now)
        elif order is not None and not order.is_acknowledged and now >= order.sending_time + RESEND and self.vehicle.takes_orders:
            self._driving.resend(order, now)
        elif job is not None and action is not None and action.action_status is ActionStatus.RETRIABLE:
            self._retry(job, state, now)
