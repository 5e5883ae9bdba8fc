"""Things: lights, doors, lifts, sensors and the like over MQTT, HTTP and Modbus, by mapping files."""
