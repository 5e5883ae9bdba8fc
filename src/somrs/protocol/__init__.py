"""Messages between components, the states of the Failure Recovery Protocol, and SOAP. No I/O, no clock."""
