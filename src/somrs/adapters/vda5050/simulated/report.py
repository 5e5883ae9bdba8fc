"""The state of a simulated vehicle, as it reports it (3.0, 6.6)."""

from __future__ import annotations

import msgspec

from somrs.adapters.vda5050.messages.header import Version
from somrs.adapters.vda5050.messages.states import EmergencyStop, OperatingMode, Position, PowerSupply, SafetyState, State
from somrs.adapters.vda5050.simulated.body import Sensed
from somrs.adapters.vda5050.simulated.complaints import Complaints
from somrs.adapters.vda5050.simulated.instant import InstantLog
from somrs.adapters.vda5050.simulated.progress import Progress
from somrs.adapters.vda5050.simulated.storage import Storage
from somrs.adapters.vda5050.simulated.zones import ZoneGuard


def state_of(
    sensed: Sensed,
    progress: Progress,
    instant: InstantLog,
    complaints: Complaints,
    storage: Storage,
    zones: ZoneGuard,
    *,
    version: Version,
    map_id: str,
    mode: OperatingMode,
    is_paused: bool,
    load: str | None,
) -> State:
    """The state of a vehicle. `load`: what it carries; None: nothing."""
    order = progress.order
    _, edges = progress.leg(map_id)
    return State(
        order_id=order.order_id if order is not None else "",
        order_update_id=order.order_update_id if order is not None else 0,
        last_node_id=progress.last_node_id,
        last_node_sequence_id=progress.last_sequence_id,
        node_states=progress.node_states(),
        edge_states=progress.edge_states(),
        driving=sensed.is_moving,
        paused=is_paused,
        new_base_request=len(edges) == 1 and any(not node.released for node in progress.nodes),
        action_states=tuple(progress.states.values()),
        instant_action_states=tuple(instant.states.values()),
        power_supply=PowerSupply(state_of_charge=round(sensed.charge, 1), charging=sensed.is_charging),
        operating_mode=mode,
        errors=complaints.errors,
        safety_state=SafetyState(active_emergency_stop=EmergencyStop.NONE, field_violation=False),
        mobile_robot_position=Position(x=sensed.x, y=sensed.y, theta=sensed.yaw, map_id=map_id, localized=True),
        loads=sensed.loads(load),
        maps=tuple(storage.maps),
        zone_sets=tuple(storage.zone_sets) if version is Version.V3_0 else None,
        zone_requests=zones.requests if version is Version.V3_0 else None,
        zone_action_states=tuple(zones.actions.states.values()) if version is Version.V3_0 else None,
    )


def event_of(state: State) -> State:
    """What of a state is sent when it changes: all but the pose and the charge."""
    power = PowerSupply(state_of_charge=0.0, charging=state.power_supply.charging)
    return msgspec.structs.replace(state, mobile_robot_position=None, power_supply=power)
