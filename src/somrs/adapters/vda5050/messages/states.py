"""What a vehicle says of itself: its state, its connection and its pose (VDA 5050 3.0, 7.7 to 7.9). Units as in `orders.py`."""

from __future__ import annotations

from enum import StrEnum

from msgspec import Struct, field

from somrs.adapters.vda5050.messages.orders import NodePosition, Trajectory


class ConnectionState(StrEnum):
    ONLINE = "ONLINE"
    OFFLINE = "OFFLINE"
    HIBERNATING = "HIBERNATING"
    CONNECTION_BROKEN = "CONNECTION_BROKEN"


class Connection(Struct, frozen=True, kw_only=True, rename="camel"):
    connection_state: ConnectionState


class OperatingMode(StrEnum):
    """Fleet control is in control in AUTOMATIC and SEMIAUTOMATIC only (3.0, 6.6.6)."""

    STARTUP = "STARTUP"
    AUTOMATIC = "AUTOMATIC"
    SEMIAUTOMATIC = "SEMIAUTOMATIC"
    INTERVENED = "INTERVENED"
    MANUAL = "MANUAL"
    SERVICE = "SERVICE"
    TEACH_IN = "TEACH_IN"


class ActionStatus(StrEnum):
    WAITING = "WAITING"
    INITIALIZING = "INITIALIZING"
    RUNNING = "RUNNING"
    PAUSED = "PAUSED"
    RETRIABLE = "RETRIABLE"
    FINISHED = "FINISHED"
    FAILED = "FAILED"

    @property
    def is_final(self) -> bool:
        return self in (ActionStatus.FINISHED, ActionStatus.FAILED)


class ErrorLevel(StrEnum):
    """How bad an error is (3.0, 6.6.5.1; 2.1 has WARNING and FATAL only)."""

    WARNING = "WARNING"
    """The vehicle goes on."""
    URGENT = "URGENT"
    """The vehicle goes on, and needs attention."""
    CRITICAL = "CRITICAL"
    """The vehicle cannot go on with its order, and can take another one."""
    FATAL = "FATAL"
    """The vehicle takes no order until somebody mends it."""


class EmergencyStop(StrEnum):
    """AUTOACK: in 2.x only; it ends by itself."""

    NONE = "NONE"
    AUTOACK = "AUTOACK"
    MANUAL = "MANUAL"
    REMOTE = "REMOTE"


class RequestStatus(StrEnum):
    REQUESTED = "REQUESTED"
    GRANTED = "GRANTED"
    REVOKED = "REVOKED"
    EXPIRED = "EXPIRED"


class MapStatus(StrEnum):
    ENABLED = "ENABLED"
    DISABLED = "DISABLED"


class StoredMap(Struct, frozen=True, kw_only=True, rename="camel"):
    map_id: str
    map_version: str
    map_status: MapStatus


class StoredZoneSet(Struct, frozen=True, kw_only=True, rename="camel"):
    zone_set_id: str
    map_id: str
    zone_set_status: MapStatus


class NodeState(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    node_id: str
    sequence_id: int
    released: bool
    node_descriptor: str | None = None
    node_position: NodePosition | None = None


class EdgeState(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    edge_id: str
    sequence_id: int
    released: bool
    edge_descriptor: str | None = None
    trajectory: Trajectory | None = None


class Position(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    """`localized`: whether the vehicle knows where it is."""

    x: float
    y: float
    theta: float
    map_id: str
    localized: bool
    localization_score: float | None = None
    deviation_range: float | None = None


class Velocity(Struct, frozen=True, kw_only=True, omit_defaults=True):
    vx: float | None = None
    vy: float | None = None
    omega: float | None = None


class BoundingBoxReference(Struct, frozen=True, kw_only=True, omit_defaults=True):
    x: float
    y: float
    z: float
    theta: float | None = None


class LoadDimensions(Struct, frozen=True, kw_only=True, omit_defaults=True):
    length: float
    width: float
    height: float | None = None


class Load(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    load_id: str | None = None
    load_type: str | None = None
    load_position: str | None = None
    bounding_box_reference: BoundingBoxReference | None = None
    load_dimensions: LoadDimensions | None = None
    weight: float | None = None


class ZoneRequest(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    request_id: str
    request_type: str
    zone_id: str
    zone_set_id: str
    request_status: RequestStatus
    trajectory: Trajectory | None = None


class EdgeRequest(Struct, frozen=True, kw_only=True, rename="camel"):
    request_id: str
    request_type: str
    edge_id: str
    sequence_id: int
    request_status: RequestStatus


class ActionState(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    action_id: str
    action_status: ActionStatus
    action_type: str | None = None
    action_descriptor: str | None = None
    action_result: str | None = None


class PowerSupply(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    """`state_of_charge`: 0 to 100. `range`: in metres. `battery_voltage`: in volts."""

    state_of_charge: float
    charging: bool
    battery_voltage: float | None = None
    battery_current: float | None = None
    battery_health: float | None = None
    range: float | None = None


class Reference(Struct, frozen=True, kw_only=True, rename="camel"):
    reference_key: str
    reference_value: str


class VehicleError(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    error_type: str
    error_level: ErrorLevel
    error_references: tuple[Reference, ...] | None = None
    error_description: str | None = None
    error_hint: str | None = None

    def reference(self, key: str) -> str | None:
        """What the error refers to by this key, such as `orderId`."""
        return next((item.reference_value for item in self.error_references or () if item.reference_key == key), None)

    def __str__(self) -> str:
        words = [self.error_type, self.error_description or "", self.error_hint or ""]
        return ": ".join(word for word in words if word)


class Information(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    info_type: str
    info_level: str
    info_references: tuple[Reference, ...] | None = None
    info_descriptor: str | None = None


class SafetyState(Struct, frozen=True, kw_only=True, rename="camel"):
    active_emergency_stop: EmergencyStop
    field_violation: bool


class State(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    """The whole state of a vehicle. 2.x has the instant actions among `action_states`."""

    order_id: str
    order_update_id: int
    last_node_id: str
    last_node_sequence_id: int
    node_states: tuple[NodeState, ...]
    edge_states: tuple[EdgeState, ...]
    driving: bool
    action_states: tuple[ActionState, ...]
    instant_action_states: tuple[ActionState, ...]
    power_supply: PowerSupply
    operating_mode: OperatingMode
    errors: tuple[VehicleError, ...]
    safety_state: SafetyState
    mobile_robot_position: Position | None = None
    velocity: Velocity | None = None
    loads: tuple[Load, ...] | None = None
    paused: bool | None = None
    new_base_request: bool | None = None
    distance_since_last_node: float | None = None
    zone_requests: tuple[ZoneRequest, ...] | None = None
    edge_requests: tuple[EdgeRequest, ...] | None = None
    zone_action_states: tuple[ActionState, ...] | None = None
    maps: tuple[StoredMap, ...] | None = None
    zone_sets: tuple[StoredZoneSet, ...] | None = None
    zone_set_id: str | None = None
    information: tuple[Information, ...] | None = field(default=None)

    @property
    def all_actions(self) -> tuple[ActionState, ...]:
        """The states of the actions of the order, and of instant actions."""
        return (*self.action_states, *self.instant_action_states)

    def action(self, action_id: str) -> ActionState | None:
        """The state of an action of the order, or of an instant action; None if the vehicle does not list it."""
        return next((item for item in self.all_actions if item.action_id == action_id), None)


class Visualization(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    reference_state_header_id: int | None = None
    mobile_robot_position: Position | None = None
    velocity: Velocity | None = None
