"""Kills adapters, the other ends of their wires, and brokers, while robots work, and looks at what becomes of their tasks."""
