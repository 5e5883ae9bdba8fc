"""VDA 5050: fleet control of vehicles over MQTT, and a simulated vehicle (versions 2.0, 2.1 and 3.0)."""
