"""The Failure Recovery Protocol: tables of states and transitions, a session for each side, and a diagram of the tables.

Paper, "Protocol for failure handling and recovery".
"""
