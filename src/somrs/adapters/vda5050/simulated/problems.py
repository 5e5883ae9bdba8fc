"""The errors that a vehicle reports about what it was sent, as each version has them (2.1, 6.6.4; 3.0, table 9)."""

from __future__ import annotations

from enum import Enum

from somrs.adapters.vda5050.messages.header import Version
from somrs.adapters.vda5050.messages.states import ErrorLevel, Reference, VehicleError


class Problem(Enum):
    """The type in 2.x, the type in 3.0, and the level there; in 2.x each is a WARNING."""

    MALFORMED = ("validationError", "VALIDATION_FAILURE", ErrorLevel.WARNING)
    UNSUPPORTED_FIELD = ("orderError", "UNSUPPORTED_PARAMETER", ErrorLevel.CRITICAL)
    UNSUPPORTED_ACTION = ("orderError", "INVALID_ORDER_ACTION", ErrorLevel.WARNING)
    NOT_AVAILABLE = ("orderError", "MOBILE_ROBOT_NOT_AVAILABLE", ErrorLevel.WARNING)
    UNKNOWN_MAP = ("orderError", "UNKNOWN_MAP_ID", ErrorLevel.WARNING)
    ANOTHER_ORDER = ("orderError", "OTHER_ORDER_ACTIVE", ErrorLevel.WARNING)
    OUT_OF_RANGE = ("orderError", "START_NODE_OUT_OF_RANGE", ErrorLevel.WARNING)
    OUTDATED = ("orderUpdateError", "OUTDATED_ORDER_UPDATE", ErrorLevel.WARNING)
    CONTENT_DIFFERS = ("orderUpdateError", "SAME_ORDER_UPDATE_ID", ErrorLevel.WARNING)
    CANCELLED = ("orderUpdateError", "ORDER_UPDATE_FOLLOWING_CANCEL", ErrorLevel.WARNING)
    NO_CONTINUATION = ("orderUpdateError", "VALIDATION_FAILURE", ErrorLevel.WARNING)
    NO_ORDER = ("noOrderToCancel", "NO_ORDER_TO_CANCEL", ErrorLevel.WARNING)
    INVALID_INSTANT_ACTION = ("instantActionError", "INVALID_INSTANT_ACTION", ErrorLevel.WARNING)
    ACTION_FAILED = ("actionError", "ACTION_FAILED", ErrorLevel.CRITICAL)
    BLOCKED = ("blocked", "BLOCKED", ErrorLevel.WARNING)
    DUPLICATE_MAP = ("duplicateMap", "DUPLICATE_MAP", ErrorLevel.WARNING)
    DUPLICATE_ZONE_SET = ("duplicateZoneSet", "DUPLICATE_ZONE_SET", ErrorLevel.WARNING)
    BLOCKED_ZONE = ("blockedZoneViolation", "BLOCKED_ZONE_VIOLATION", ErrorLevel.CRITICAL)
    RELEASE_LOST = ("releaseLost", "RELEASE_LOST", ErrorLevel.CRITICAL)
    UNREACHABLE = ("nodeUnreachable", "NODE_UNREACHABLE", ErrorLevel.CRITICAL)

    def error(self, version: Version, description: str, **references: str) -> VehicleError:
        type_in_2, type_in_3, level = self.value
        return VehicleError(
            error_type=type_in_3 if version is Version.V3_0 else type_in_2,
            error_level=level if version is Version.V3_0 else ErrorLevel.WARNING,
            error_description=description,
            error_references=tuple(Reference(reference_key=key, reference_value=value) for key, value in references.items()),
        )
