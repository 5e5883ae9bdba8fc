"""When a test is taken to hang."""

HANG_TIME = 900.0
"""Seconds. A test that waits for something gives up then, to say what it waits for. None takes as long because the machine is busy: those
that take longest need ten seconds on an idle one."""
