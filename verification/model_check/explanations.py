"""Explains the mutations that violate no property. The check reports an explanation whose mutation does violate one."""

from __future__ import annotations

from collections.abc import Iterable

Pattern = tuple[str, str, str, str]
"""Table, state, message and change, as in a `Mutation`; for a rule, its name in place of the state."""

UNUSED_ENTRY = "never used"

REPEATED = "earlier only: the report is repeated until it is acknowledged, whether it is requested again or not"
OVERTAKEN = "earlier only: its next report, or its Refuse, is answered with End or Cancel again, and then it ends"
LOST = "earlier only: a Query follows the silence of a participant that lost its journal, and finds that it has no contract"
LOST_AGAIN = "never used: a lost journal is explored where no message is repeated, so no Arrange follows the loss"
NO_CANCEL = "never used: Cancel is not sent after Execute; the entry stays, as leaving is never refused"
BREAKS_RULES = "never used: one side would have to violate the protocol; the entry stays, as a protection against such sides"
FAULT = "never used: no Fault is sent, as no message is malformed or unexpected; the entry stays, against faulty implementations"
STATUS_ONLY = "no effect: a participant that has its journal reports its state for information only"
MONITORED = "no effect here: Progress informs people, and resets a timer that can fire at any time in the model"
ONLY_IF_LATE = "not needed if the timing assumption holds: a device that was given up does not move"
OTHER_SIDE = "not needed if the other side follows the protocol: an order states the condition, or is not sent; it protects against others"


def _explain_each(
    table: str, states: Iterable[str], messages: Iterable[str], changes: Iterable[str], explanation: str
) -> dict[Pattern, str]:
    return {(table, state, message, change): explanation for state in states for message in messages for change in changes}


WORK = ("Accept", "Execute", "Stop", "Compensate")
REPORTS = ("Completed", "Failed", "Stopped", "Compensated", "Stranded")

EXPLANATIONS: dict[Pattern, str] = {
    **_explain_each("PARTICIPANT", ("New",), WORK, ("ignored",), LOST),
    **_explain_each("PARTICIPANT", ("New",), ("Accept", "Execute"), ("Ended",), LOST),
    ("PARTICIPANT", "New", "Compensate", "Ended"): "earlier only: it ends at once, and its report of the compensation is the same",
    ("PARTICIPANT", "New", "End", "ignored"): "no effect: a participant without a record has nothing to end",
    **_explain_each("PARTICIPANT", ("Arranging",), WORK, ("ignored", "unanswered", "Ended"), LOST_AGAIN),
    **_explain_each("PARTICIPANT", ("Arranging",), ("End",), ("ignored",), "never used: Cancel comes instead without a contract"),
    **_explain_each("PARTICIPANT", ("Arranging",), ("Cancel",), ("ignored",), OVERTAKEN),
    **_explain_each("PARTICIPANT", ("Offered",), ("Arrange",), ("ignored",), REPEATED),
    ("PARTICIPANT", "Offered", "Accept", "ignored"): "equivalent: the Execute that follows names the Terms, and counts as an Accept",
    **_explain_each("PARTICIPANT", ("Offered", "Committed"), ("Compensate",), ("ignored", "unanswered", "Ended"), BREAKS_RULES),
    **_explain_each("PARTICIPANT", ("Executing", "Stopping"), ("Compensate",), ("ignored",), BREAKS_RULES),
    **_explain_each(
        "PARTICIPANT",
        ("Executing", "Completed", "Stopping", "Stopped", "Compensating", "Compensated", "Stranded"),
        ("Cancel",),
        ("ignored",),
        NO_CANCEL,
    ),
    **_explain_each("PARTICIPANT", ("Completed", "Failed"), ("Execute", "Stop"), ("ignored",), REPEATED),
    **_explain_each("PARTICIPANT", ("Stopped",), ("Stop",), ("ignored",), REPEATED),
    **_explain_each("PARTICIPANT", ("Compensated", "Stranded"), ("Compensate",), ("ignored",), REPEATED),
    **_explain_each("PARTICIPANT", ("Stopping", "Compensating"), ("End",), ("ignored",), OVERTAKEN),
    **_explain_each(
        "PARTICIPANT",
        ("Executing", "Completed", "Failed", "Stopping", "Stopped", "Compensating", "Compensated",
         "Stranded", "Ended"),
        ("Query",),
        ("ignored",),
        STATUS_ONLY,
    ),
    **_explain_each("PARTICIPANT", ("Arranging", "Offered"), ("Query",), ("ignored",),
                    f"{UNUSED_ENTRY}: only a participant with a contract is queried"),
    **_explain_each("COORDINATOR", ("New",), ("Terms",), ("ignored", "unanswered"), "earlier only: Terms without an Accept expire"),
    **_explain_each("COORDINATOR", ("Arranging", "Offered"), ("Progress", *REPORTS), ("ignored", "unanswered"), BREAKS_RULES),
    **_explain_each("COORDINATOR", ("Arranging", "Offered"), ("Fault",), ("ignored", "unanswered"), FAULT),
    **_explain_each("COORDINATOR", ("Committed", "Executing", "Compensating"), ("Fault",), ("ignored", "Ended"), FAULT),
    **_explain_each("COORDINATOR", ("Executing", "Stopping", "Compensating"), ("Progress",), ("ignored",), MONITORED),
    ("COORDINATOR", "Stranded", "Compensated", "ignored"): "better report only: the client sees work as left that was undone",
    **_explain_each("COORDINATOR", ("Ended",), ("Terms", "Progress", *REPORTS), ("ignored",),
                    "earlier only: End and Cancel are repeated for a day"),
    ("COORDINATOR", "Unreachable", "Refuse", "ignored"): "earlier only: its End follows with the end of the transaction",
    **_explain_each("COORDINATOR", ("Unreachable",), ("Progress",), ("ignored", "unanswered"), ONLY_IF_LATE),
    ("PARTICIPANT_SENDS", "Executing", "Stopped", "ignored"): "equivalent: Failed reports the same; for devices that people stop",
    ("COORDINATOR_SENDS", "Committed", "End", "ignored"): "equivalent: Cancel is sent instead",
    **_explain_each("ABANDONED_STATES", ("Committed",), ("",), ("ignored", "Failed"),
                    "equivalent: it has not begun, and Cancel releases the step"),
    ("ABANDONED_STATES", "Executing", "", "ignored"): "equivalent: it receives Stop, and is given up in the state Stopping",
    ("RULES", "condition in Execute, coordinator", "", "not required"): OTHER_SIDE,
    ("RULES", "condition in Execute, participant", "", "not required"): OTHER_SIDE,
    ("RESUMES", "Executing", "", "Stopped"): "equivalent: both report that the work was interrupted, and where",
    ("RESUMES", "Stopping", "", "Failed"): "equivalent: both report that the work was interrupted, and where",
}  # fmt: skip
