"""Kills real processes of a running system at a drawn message of the protocol, and sees whether all goes on as if nothing had been."""
