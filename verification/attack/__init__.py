"""Attacks on a running system: what its servers promise to refuse, they refuse, and they go on serving."""
