"""Fleet control of one vehicle: a state machine without I/O and clock. What comes in and goes out is in `exchange.py`."""
