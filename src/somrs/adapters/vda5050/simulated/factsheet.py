"""The factsheet of a simulated vehicle."""

from __future__ import annotations

from somrs.adapters.vda5050.messages.factsheets import (
    ArrayLengths,
    BatteryCharging,
    Configuration,
    Factsheet,
    Geometry,
    LoadSet,
    LoadSpecification,
    OptionalParameter,
    PhysicalParameters,
    ProtocolFeatures,
    ProtocolLimits,
    StringLengths,
    SupportedAction,
    Timing,
    TypeSpecification,
)
from somrs.adapters.vda5050.simulated.zones import SUPPORTED

NODE_ACTIONS = ("pick", "drop", "startCharging", "stopCharging", "waitForTrigger", "finePositioning", "detectObject")

PARAMETERS = (
    "order.nodes.nodePosition", "order.nodes.nodePosition.theta", "order.nodes.nodePosition.allowedDeviationXY", "order.edges.maximumSpeed",
    "order.edges.orientation", "order.edges.orientationType", "order.nodes.actions.retriable",
)  # fmt: skip
"""The optional parameters that every simulated vehicle takes."""

INSTANT_ACTIONS = (
    "cancelOrder", "startPause", "stopPause", "stateRequest", "factsheetRequest", "stopCharging", "initializePosition",
    "clearInstantActions", "trigger", "downloadMap", "enableMap", "deleteMap", "enableZoneSet", "deleteZoneSet", "retry", "skipRetry",
    "startHibernation", "stopHibernation", "clearZoneActions",
)  # fmt: skip

LOADS = LoadSet(set_name="DEFAULT", load_type="DEFAULT", pick_time=7.0, drop_time=8.0)
"""What it carries, and about how long a robot of the simulator takes to pick it and to drop it, s."""


def factsheet(
    *,
    series: str = "SO-MRS simulated",
    payload: float = 20.0,
    speed: float = 1.0,
    width: float = 0.6,
    length: float = 0.8,
    handles: bool = True,
    takes_trajectories: bool = False,
    finds_paths: bool = False,
    supported_zones: tuple[str, ...] = SUPPORTED,
    zone_actions: tuple[str, ...] = (),
) -> Factsheet:
    """The factsheet of a vehicle. `handles`: it can pick and drop loads. `takes_trajectories`: edges may have them; it drives in
    straight lines all the same. `finds_paths`: it says that it plans its paths by itself. `zone_actions`: of 3.0."""
    parameters = [*PARAMETERS, *(["order.edges.trajectory"] if takes_trajectories else [])]
    types = [action_type for action_type in NODE_ACTIONS if handles or action_type not in ("pick", "drop")]
    actions = {
        action_type: [*_scope(action_type, INSTANT_ACTIONS, "INSTANT"), *_scope(action_type, types, "NODE")] for action_type in types
    }
    actions |= {action_type: ["INSTANT"] for action_type in INSTANT_ACTIONS if action_type not in actions}
    actions |= {action_type: [*actions.get(action_type, []), "ZONE"] for action_type in zone_actions}
    return Factsheet(
        type_specification=TypeSpecification(
            series_name=series,
            mobile_robot_kinematics="DIFFERENTIAL",
            mobile_robot_class="CARRIER",
            maximum_load_mass=payload,
            localization_types=("NATURAL",),
            navigation_types=("FREELY_NAVIGATING",) if finds_paths else ("VIRTUAL_LINE_GUIDED",),
            supported_zones=supported_zones,
        ),
        physical_parameters=PhysicalParameters(
            minimum_speed=0.0,
            maximum_speed=speed,
            maximum_acceleration=1.0,
            maximum_deceleration=1.0,
            minimum_height=0.3,
            maximum_height=0.6,
            width=width,
            length=length,
            maximum_angular_speed=2.0,
        ),
        protocol_limits=ProtocolLimits(
            maximum_string_lengths=StringLengths(),
            maximum_array_lengths=ArrayLengths(),
            timing=Timing(minimum_order_interval=0.0, minimum_state_interval=0.0, default_state_interval=1.0),
        ),
        protocol_features=ProtocolFeatures(
            optional_parameters=tuple(OptionalParameter(parameter=parameter, support="SUPPORTED") for parameter in parameters),
            mobile_robot_actions=tuple(
                SupportedAction(action_type=action_type, action_scopes=tuple(scopes), pause_allowed=False, cancel_allowed=True)
                for action_type, scopes in actions.items()
            ),
        ),
        mobile_robot_geometry=Geometry(),
        load_specification=LoadSpecification(load_positions=("top",), load_sets=(LOADS,)) if handles else LoadSpecification(),
        mobile_robot_configuration=Configuration(battery_charging=BatteryCharging(maximum_desired_charging_level=99.0)),
    )


def _scope(action_type: str, types: tuple[str, ...] | list[str], scope: str) -> list[str]:
    return [scope] if action_type in types else []
