"""What programs use to talk to a running system, and the reports that they make of its records."""
