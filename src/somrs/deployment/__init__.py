"""The processes of a system: how they are started, supervised and stopped."""
