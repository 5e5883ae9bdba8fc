"""What a vehicle is and can do (VDA 5050 3.0, 7.10). Masses are in kilograms, accelerations in metres per second squared."""

from __future__ import annotations

from msgspec import Struct, field

from somrs.adapters.vda5050.messages.orders import Vertex
from somrs.adapters.vda5050.messages.states import BoundingBoxReference, LoadDimensions


class TypeSpecification(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    """`mobile_robot_class`: FORKLIFT, CONVEYOR, TUGGER, CARRIER, or another word."""

    series_name: str
    mobile_robot_kinematics: str
    mobile_robot_class: str
    maximum_load_mass: float
    localization_types: tuple[str, ...]
    navigation_types: tuple[str, ...]
    series_description: str | None = None
    supported_zones: tuple[str, ...] | None = None


class PhysicalParameters(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    minimum_speed: float
    maximum_speed: float
    maximum_acceleration: float
    maximum_deceleration: float
    minimum_height: float
    maximum_height: float
    width: float
    length: float
    minimum_angular_speed: float | None = None
    maximum_angular_speed: float | None = None


class StringLengths(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    maximum_message_length: int | None = None
    maximum_topic_serial_length: int | None = None
    maximum_topic_element_length: int | None = None
    maximum_id_length: int | None = None
    id_numerical_only: bool | None = None
    maximum_load_id_length: int | None = None


class ArrayLengths(Struct, frozen=True, kw_only=True, omit_defaults=True):
    order_nodes: int | None = field(default=None, name="order.nodes")
    order_edges: int | None = field(default=None, name="order.edges")
    node_actions: int | None = field(default=None, name="node.actions")
    instant_actions: int | None = field(default=None, name="instantActions")
    zone_set_zones: int | None = field(default=None, name="zoneSet.zones")


class Timing(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    """In seconds."""

    minimum_order_interval: float
    minimum_state_interval: float
    default_state_interval: float | None = None
    visualization_interval: float | None = None


class ProtocolLimits(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    maximum_string_lengths: StringLengths
    maximum_array_lengths: ArrayLengths
    timing: Timing


class OptionalParameter(Struct, frozen=True, kw_only=True, omit_defaults=True):
    parameter: str
    support: str
    description: str | None = None


class SupportedParameter(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    key: str
    value_data_type: str
    description: str | None = None
    is_optional: bool | None = None


class SupportedAction(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    """`pause_allowed`, `cancel_allowed`: in 3.0 only, which requires them."""

    action_type: str
    action_scopes: tuple[str, ...]
    pause_allowed: bool | None = None
    cancel_allowed: bool | None = None
    action_description: str | None = None
    action_parameters: tuple[SupportedParameter, ...] | None = None
    action_result: str | None = None
    blocking_types: tuple[str, ...] | None = None


class ProtocolFeatures(Struct, frozen=True, kw_only=True, rename="camel"):
    optional_parameters: tuple[OptionalParameter, ...]
    mobile_robot_actions: tuple[SupportedAction, ...]


class Envelope(Struct, frozen=True, kw_only=True, omit_defaults=True):
    envelope_id: str = field(name="envelope2dId")
    vertices: tuple[Vertex, ...]
    description: str | None = None


class Geometry(Struct, frozen=True, kw_only=True, omit_defaults=True):
    envelopes_2d: tuple[Envelope, ...] | None = field(default=None, name="envelopes2d")


class LoadSet(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    set_name: str
    load_type: str
    load_positions: tuple[str, ...] | None = None
    bounding_box_reference: BoundingBoxReference | None = None
    load_dimensions: LoadDimensions | None = None
    maximum_weight: float | None = None
    minimum_loadhandling_height: float | None = None
    maximum_loadhandling_height: float | None = None
    maximum_speed: float | None = None
    pick_time: float | None = None
    drop_time: float | None = None


class LoadSpecification(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    load_positions: tuple[str, ...] | None = None
    load_sets: tuple[LoadSet, ...] | None = None


class BatteryCharging(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    """States of charge, 0 to 100, and the time for which a vehicle charges at least, in seconds."""

    critical_low_charging_level: float | None = None
    minimum_desired_charging_level: float | None = None
    maximum_desired_charging_level: float | None = None
    minimum_charging_time: float | None = None


class Configuration(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    battery_charging: BatteryCharging | None = None


OWN_TOPICS = frozenset({"state", "visualization", "connection", "factsheet"})
"""What vehicles send: optional parameters of these are none of orders."""


class Factsheet(Struct, frozen=True, kw_only=True, rename="camel", omit_defaults=True):
    type_specification: TypeSpecification
    physical_parameters: PhysicalParameters
    protocol_limits: ProtocolLimits
    protocol_features: ProtocolFeatures
    mobile_robot_geometry: Geometry
    load_specification: LoadSpecification
    mobile_robot_configuration: Configuration | None = None

    @property
    def charging(self) -> BatteryCharging:
        """What the vehicle wants of charging, as far as it says it."""
        configuration = self.mobile_robot_configuration
        charging = configuration.battery_charging if configuration is not None else None
        return charging if charging is not None else BatteryCharging()

    def action(self, action_type: str) -> SupportedAction | None:
        """The action of this type, if the vehicle has it."""
        return next((action for action in self.protocol_features.mobile_robot_actions if action.action_type == action_type), None)

    def takes(self, parameter: str) -> bool:
        """Whether the vehicle takes an optional parameter of orders, such as `trajectory`; others are not to be sent (3.0, 7.1.1). Vehicles
        differ in how they write where it is."""
        names = [supported.parameter for supported in self.protocol_features.optional_parameters]
        return any(name.rpartition(".")[2] == parameter and name.partition(".")[0] not in OWN_TOPICS for name in names)
