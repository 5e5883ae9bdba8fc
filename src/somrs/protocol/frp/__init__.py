"""The Failure Recovery Protocol: its states and transitions as tables, a session at each side, and the diagram.

Paper, "Protocol for failure handling and recovery".
"""
