"""What 2.0 and 2.1 call otherwise than 3.0: names of fields and values, and the fields that only one of them has."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from msgspec import Struct

from somrs.adapters.vda5050.messages.factsheets import (
    ArrayLengths,
    Configuration,
    Envelope,
    Factsheet,
    LoadSet,
    OptionalParameter,
    PhysicalParameters,
    ProtocolFeatures,
    ProtocolLimits,
    StringLengths,
    SupportedAction,
    Timing,
    TypeSpecification,
)
from somrs.adapters.vda5050.messages.header import Version
from somrs.adapters.vda5050.messages.orders import Action, BlockingType, Corridor, Edge, InstantActions, Node, Order
from somrs.adapters.vda5050.messages.states import (
    ActionState,
    ConnectionState,
    EdgeState,
    ErrorLevel,
    Information,
    NodeState,
    OperatingMode,
    Position,
    PowerSupply,
    SafetyState,
    State,
    Visualization,
)

NAMES_IN_2: Mapping[type[Struct], Mapping[str, str]] = {
    Action: {"actionDescriptor": "actionDescription"},
    Node: {"nodeDescriptor": "nodeDescription"},
    Edge: {
        "edgeDescriptor": "edgeDescription",
        "maximumSpeed": "maxSpeed",
        "maximumMobileRobotHeight": "maxHeight",
        "minimumLoadHandlingDeviceHeight": "minHeight",
        "maximumRotationSpeed": "maxRotationSpeed",
    },
    Corridor: {"corridorReferencePoint": "corridorRefPoint"},
    State: {"mobileRobotPosition": "agvPosition", "powerSupply": "batteryState"},
    Visualization: {"mobileRobotPosition": "agvPosition"},
    NodeState: {"nodeDescriptor": "nodeDescription"},
    EdgeState: {"edgeDescriptor": "edgeDescription"},
    Position: {"localized": "positionInitialized"},
    ActionState: {"actionDescriptor": "actionDescription", "actionResult": "resultDescription"},
    PowerSupply: {"stateOfCharge": "batteryCharge", "range": "reach"},
    Information: {"infoDescriptor": "infoDescription"},
    SafetyState: {"activeEmergencyStop": "eStop"},
    Factsheet: {"mobileRobotGeometry": "agvGeometry", "mobileRobotConfiguration": "vehicleConfig"},
    TypeSpecification: {"mobileRobotKinematics": "agvKinematic", "mobileRobotClass": "agvClass", "maximumLoadMass": "maxLoadMass"},
    PhysicalParameters: {
        "minimumSpeed": "speedMin",
        "maximumSpeed": "speedMax",
        "maximumAcceleration": "accelerationMax",
        "maximumDeceleration": "decelerationMax",
        "minimumHeight": "heightMin",
        "maximumHeight": "heightMax",
    },
    ProtocolLimits: {"maximumStringLengths": "maxStringLens", "maximumArrayLengths": "maxArrayLens"},
    StringLengths: {
        "maximumMessageLength": "msgLen",
        "maximumTopicSerialLength": "topicSerialLen",
        "maximumTopicElementLength": "topicElemLen",
        "maximumIdLength": "idLen",
        "maximumLoadIdLength": "loadIdLen",
    },
    Timing: {"minimumOrderInterval": "minOrderInterval", "minimumStateInterval": "minStateInterval"},
    ProtocolFeatures: {"mobileRobotActions": "agvActions"},
    SupportedAction: {"actionResult": "resultDescription"},
    Envelope: {"envelope2dId": "set", "vertices": "polygonPoints"},
    LoadSet: {
        "maximumWeight": "maxWeight",
        "maximumSpeed": "agvSpeedLimit",
        "minimumLoadhandlingHeight": "minLoadhandlingHeight",
        "maximumLoadhandlingHeight": "maxLoadhandlingHeight",
    },
}
"""By struct: the names of its fields in 3.0, and in 2.0 and 2.1."""

NAMES_IN_2_0: Mapping[type[Struct], Mapping[str, str]] = {InstantActions: {"actions": "instantActions"}}
"""What 2.0 alone calls otherwise."""

FIELDS_OF_3: Mapping[type[Struct], frozenset[str]] = {
    Action: frozenset({"retriable"}),
    Order: frozenset({"orderDescription"}),
    Edge: frozenset({"reachOrientationBeforeEntering"}),
    Corridor: frozenset({"releaseRequired", "releaseLossBehavior"}),
    State: frozenset({"instantActionStates", "zoneRequests", "edgeRequests", "zoneActionStates", "zoneSets"}),
    PowerSupply: frozenset({"batteryCurrent"}),
    Visualization: frozenset({"referenceStateHeaderId"}),
    TypeSpecification: frozenset({"supportedZones"}),
    PhysicalParameters: frozenset({"minimumAngularSpeed", "maximumAngularSpeed"}),
    SupportedAction: frozenset({"pauseAllowed", "cancelAllowed"}),
    Configuration: frozenset({"batteryCharging"}),
    ArrayLengths: frozenset({"zoneSet.zones"}),
}

FIELDS_OF_2: Mapping[type[Struct], frozenset[str]] = {
    Edge: frozenset({"startNodeId", "endNodeId"}),
    Order: frozenset({"zoneSetId"}),
    State: frozenset({"zoneSetId"}),
}

VALUES_IN_2: Mapping[StrEnum, str] = {
    ConnectionState.CONNECTION_BROKEN: "CONNECTIONBROKEN",
    ConnectionState.HIBERNATING: "OFFLINE",
    OperatingMode.TEACH_IN: "TEACHIN",
    OperatingMode.STARTUP: "SERVICE",
    OperatingMode.INTERVENED: "MANUAL",
    BlockingType.SINGLE: "HARD",
    ErrorLevel.URGENT: "WARNING",
    ErrorLevel.CRITICAL: "FATAL",
}
"""Values of enumerations; those that 2.x does not have become the next stricter one."""

WORDS_IN_2: Mapping[tuple[type[Struct], str], Mapping[str, str]] = {
    (Action, "actionType"): {"initializePosition": "initPosition"},
    (ActionState, "actionType"): {"initializePosition": "initPosition"},
    (SupportedAction, "actionType"): {"initializePosition": "initPosition"},
    (Corridor, "corridorReferencePoint"): {"KINEMATIC_CENTER": "KINEMATICCENTER"},
    (TypeSpecification, "mobileRobotKinematics"): {
        "DIFFERENTIAL": "DIFF",
        "OMNIDIRECTIONAL": "OMNI",
        "THREE_WHEEL": "THREEWHEEL",
    },
    (OptionalParameter, "parameter"): {"order.edges.maximumSpeed": "order.edges.maxSpeed"},
    (TypeSpecification, "navigationTypes"): {"FREELY_NAVIGATING": "AUTONOMOUS"},
}
"""By struct and field of 3.0: words in open sets, in 3.0 and in 2.0 and 2.1."""


def wire_name(owner: type[Struct], name: str, version: Version) -> str:
    """The name of a field in a version, by its name in 3.0."""
    if version is Version.V3_0:
        return name
    if version is Version.V2_0 and (earlier_name := NAMES_IN_2_0.get(owner, {}).get(name)) is not None:
        return earlier_name
    return NAMES_IN_2.get(owner, {}).get(name, name)


def has_field(owner: type[Struct], name: str, version: Version) -> bool:
    """Whether the version has the field, by its name in 3.0."""
    missing = FIELDS_OF_2 if version is Version.V3_0 else FIELDS_OF_3
    return name not in missing.get(owner, ())
