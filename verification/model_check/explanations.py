"""Why some alterations of the tables make no property fall. An explanation of one that is noticed after all is reported, too."""

from __future__ import annotations

from collections.abc import Iterable

Pattern = tuple[str, str, str, str]
"""Table, state, message and alteration, as in a `Mutation`."""

UNUSED_ENTRY = "never met"

REPEATED = "sooner only: the report is repeated until it is acknowledged, whether it is asked for again or not"
OVERTAKEN = "sooner only: its next report, or its lapse, is answered with End or Cancel again, and then it ends"
LOST = "sooner only: one that lost its journal is found out by the question that follows its silence"
LOST_AGAIN = "never met: one that lost its journal and is arranged anew; a lost journal is explored where no message is repeated"
NO_CANCEL = "never met: Cancel is not said after Execute; it stays, as leaving is never refused"
BREAKS_RULES = "never met: one of the two would have to break the rules; it stays, against those that do"
FAULT = "never met: no Fault is said, as nothing is malformed and nothing does not fit; it stays, against those that cannot read"
STATUS_ONLY = "changes nothing: who keeps its journal says its state to people and programs only"
MONITORED = "changes nothing here: it is news for people, and a sign of life for a timer that may ring at any time"
ONLY_IF_LATE = "never needed as long as the timing assumption holds: a device that was given up does not move"


def _explain_each(
    table: str, states: Iterable[str], messages: Iterable[str], changes: Iterable[str], explanation: str
) -> dict[Pattern, str]:
    return {(table, state, message, change): explanation for state in states for message in messages for change in changes}


WORK = ("Accept", "Execute", "Stop", "Compensate")
REPORTS = ("Completed", "Failed", "Stopped", "Compensated", "Stranded")

EXPLANATIONS: dict[Pattern, str] = {
    **_explain_each("PARTICIPANT", ("New",), WORK, ("ignored",), LOST),
    ("PARTICIPANT", "New", "Compensate", "Ended"): "sooner only: it is free then, and what it says of the undoing is the same",
    ("PARTICIPANT", "New", "End", "ignored"): "changes nothing: one that knows nothing is free",
    **_explain_each("PARTICIPANT", ("Arranging",), WORK, ("ignored", "unanswered", "Ended"), LOST_AGAIN),
    **_explain_each("PARTICIPANT", ("Arranging",), ("End",), ("ignored",), "never met: one that was not committed hears Cancel instead"),
    **_explain_each("PARTICIPANT", ("Arranging",), ("Cancel",), ("ignored",), OVERTAKEN),
    **_explain_each("PARTICIPANT", ("Offered",), ("Arrange",), ("ignored",), REPEATED),
    ("PARTICIPANT", "Offered", "Accept", "ignored"): "equivalent: the Execute that follows names the terms, and is an Accept",
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
    **_explain_each("PARTICIPANT", ("Arranging", "Offered", "Committed"), ("Query",), ("ignored",),
                    f"{UNUSED_ENTRY}: one that works is asked"),
    **_explain_each("COORDINATOR", ("New",), ("Terms",), ("ignored", "unanswered"), "sooner only: terms that nobody accepts expire"),
    **_explain_each("COORDINATOR", ("Arranging", "Offered"), ("Progress", *REPORTS), ("ignored", "unanswered"), BREAKS_RULES),
    **_explain_each("COORDINATOR", ("Arranging", "Offered"), ("Fault",), ("ignored", "unanswered"), FAULT),
    **_explain_each("COORDINATOR", ("Committed", "Executing", "Compensating"), ("Fault",), ("ignored", "Ended"), FAULT),
    **_explain_each("COORDINATOR", ("Executing", "Stopping", "Compensating"), ("Progress",), ("ignored",), MONITORED),
    ("COORDINATOR", "Stranded", "Compensated", "ignored"): "better news only: the client is told of something left that was undone",
    **_explain_each("COORDINATOR", ("Ended",), ("Terms", "Progress", *REPORTS), ("ignored",),
                    "sooner only: End and Cancel are repeated for a day"),
    ("COORDINATOR", "Unreachable", "Refuse", "ignored"): "sooner only: its End follows with the transaction's",
    **_explain_each("COORDINATOR", ("Unreachable",), ("Progress",), ("ignored", "unanswered"), ONLY_IF_LATE),
    ("PARTICIPANT_SENDS", "Executing", "Stopped", "ignored"): "equivalent: Failed says as much; it is for devices that people can halt",
    ("COORDINATOR_SENDS", "Committed", "End", "ignored"): "equivalent: Cancel is said instead",
    **_explain_each("ABANDONED_STATES", ("Committed",), ("",), ("ignored", "Failed"),
                    "equivalent: it has not begun, and Cancel takes the step from it"),
    ("ABANDONED_STATES", "Executing", "", "ignored"): "equivalent: it is told to stop, and given up as it stops",
    ("RESUMES", "Executing", "", "Stopped"): "equivalent: both say that the work was interrupted, and where",
    ("RESUMES", "Stopping", "", "Failed"): "equivalent: both say that the work was interrupted, and where",
}  # fmt: skip
