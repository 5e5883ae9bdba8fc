"""Kills adapters, the other ends of their wires, and brokers, while robots drive."""
