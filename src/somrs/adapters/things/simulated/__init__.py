"""The other end of the session interface: lifts and doors that are simulated, over MQTT and HTTP. For tests, and to try it out."""
