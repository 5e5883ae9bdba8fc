"""What components say to each other, the Failure Recovery Protocol's states, and SOAP. No I/O, no clock."""
