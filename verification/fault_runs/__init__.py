"""Runs whole systems on virtual time with random faults, and checks the properties of the protocol in each run."""
