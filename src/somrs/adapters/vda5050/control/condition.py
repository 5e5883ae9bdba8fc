"""What a state says about whether the vehicle can drive, and about what becomes of its order."""

from __future__ import annotations

from collections.abc import Collection

from somrs.adapters.vda5050.messages.states import ActionState, EmergencyStop, ErrorLevel, OperatingMode, State, VehicleError

IN_CONTROL = frozenset({OperatingMode.AUTOMATIC, OperatingMode.SEMIAUTOMATIC})
"""Modes in which fleet control is in control (3.0, table 11)."""

CLEARING = frozenset({OperatingMode.MANUAL, OperatingMode.STARTUP, OperatingMode.SERVICE, OperatingMode.TEACH_IN})
"""Modes in which the vehicle drops its order, and takes no instant actions (3.0, table 11)."""

REJECTIONS = frozenset(
    {
        "VALIDATIONERROR", "ORDERERROR", "ORDERUPDATEERROR", "NOROUTEERROR", "VALIDATIONFAILURE", "UNSUPPORTEDPARAMETER",
        "INVALIDORDER", "INVALIDORDERACTION", "OUTDATEDORDERUPDATE", "SAMEORDERUPDATEID", "ORDERUPDATEFOLLOWINGCANCEL",
        "OTHERORDERACTIVE", "STARTNODEOUTOFRANGE", "NOROUTETOTARGET", "MOBILEROBOTNOTAVAILABLE", "UNKNOWNMAPID", "INSUFFICIENTMEMORY",
    }
)  # fmt: skip
"""Types of errors by which vehicles reject orders (2.1, 6.6.4; 3.0, table 9), without underscores and in capital letters."""

ABOUT_MESSAGES = frozenset({"NOORDERTOCANCEL", "INSTANTACTIONERROR", "INVALIDINSTANTACTION", "DUPLICATEMAP", "DUPLICATEZONESET"})
"""Types of errors by which vehicles refuse other messages."""

INSTANT = frozenset(
    {
        "cancelOrder", "startPause", "stopPause", "stateRequest", "factsheetRequest", "logReport", "stopCharging", "initializePosition",
        "clearInstantActions", "skipRetry", "retry", "enableMap", "downloadMap", "deleteMap", "enableZoneSet", "deleteZoneSet",
        "startHibernation", "stopHibernation", "clearZoneActions",
    }
)  # fmt: skip
"""Types of instant actions; none of them makes the vehicle drive."""


def plain_type(error: VehicleError) -> str:
    """The type of an error, without underscores and in capital letters."""
    return error.error_type.replace("_", "").upper()


def hindrance(state: State) -> str | None:
    """Why the vehicle cannot drive until somebody does something at it; None if it can."""
    reasons = [str(error) for error in state.errors if error.error_level is ErrorLevel.FATAL]
    if state.operating_mode not in IN_CONTROL:
        reasons.insert(0, f"is in the operating mode {state.operating_mode}")
    if (stop := state.safety_state.active_emergency_stop) in (EmergencyStop.MANUAL, EmergencyStop.REMOTE):
        reasons.append(f"its emergency stop ({stop}) is active")
    position = state.mobile_robot_position
    if position is not None and not position.localized:
        reasons.append("does not know where it is")
    return "; ".join(dict.fromkeys(reasons)) or None


def warnings(state: State) -> list[VehicleError]:
    """The errors that do not stop the vehicle."""
    return [error for error in state.errors if error.error_level in (ErrorLevel.WARNING, ErrorLevel.URGENT)]


def remark(state: State) -> str | None:
    """What those should know whose task the vehicle works on; what it says about messages is for the log."""
    words = [
        f"{error} (needs attention)" if error.error_level is ErrorLevel.URGENT else str(error)
        for error in warnings(state)
        if plain_type(error) not in REJECTIONS | ABOUT_MESSAGES
    ]
    return "; ".join(dict.fromkeys(words)) or None


def delay(state: State) -> str | None:
    """What keeps the vehicle from going on, and will pass without fleet control; None: nothing."""
    reasons = ["is paused"] if state.paused else []
    if state.safety_state.field_violation or state.safety_state.active_emergency_stop is EmergencyStop.AUTOACK:
        reasons.append("something is in its protective field")
    return "; ".join(reasons) or None


def is_idle(state: State) -> bool:
    """Whether the vehicle has no order (3.0, 6.6.8), and stands."""
    return not state.node_states and not state.edge_states and stands(state)


def stands(state: State) -> bool:
    """Whether the vehicle does not drive, and performs no action of an order."""
    return not state.driving and all(action.action_status.is_final for action in order_actions(state))


def order_actions(state: State) -> list[ActionState]:
    """The actions of the order. 2.x lists the instant actions among them, which are told by their types."""
    return [action for action in state.action_states if action.action_type not in INSTANT]


def rejection(state: State, order_id: str, update_id: int, earlier: Collection[VehicleError]) -> VehicleError | None:
    """The error by which the vehicle rejects an order. `earlier`: the errors that it had when the order was sent."""
    for error in state.errors:
        if plain_type(error) not in REJECTIONS:
            continue
        referenced = error.reference("orderId")
        if referenced is None and error not in earlier:
            return error
        if referenced == order_id and error.reference("orderUpdateId") in (None, str(update_id)):
            return error
    return None


def rejection_words(state: State) -> list[str]:
    """What the vehicle says about messages that it does not take."""
    return list(dict.fromkeys(str(error) for error in state.errors if plain_type(error) in REJECTIONS))


def failure(state: State, earlier: Collection[VehicleError]) -> VehicleError | None:
    """The error for which the vehicle cannot go on with its order, and could take another one."""
    return next((error for error in state.errors if error.error_level is ErrorLevel.CRITICAL and error not in earlier), None)


def words_about(state: State, action_id: str, earlier_words: str | None = None) -> str:
    """What the vehicle says about an action that failed. `earlier_words`: what it said about it, when it could still be tried again."""
    words = [str(error) for error in state.errors if error.reference("actionId") == action_id]
    action = state.action(action_id)
    if action is not None and action.action_result:
        words.append(action.action_result)
    if not words:
        words = [str(error) for error in state.errors if error.error_level in (ErrorLevel.CRITICAL, ErrorLevel.FATAL)]
    return "; ".join(dict.fromkeys(words)) or earlier_words or "the vehicle does not say why"
