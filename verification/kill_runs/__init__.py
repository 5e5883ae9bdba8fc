"""Kills real processes of a running system at a random message of the protocol, and checks that the result is the same as without."""
