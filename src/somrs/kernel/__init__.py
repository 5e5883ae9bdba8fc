"""What every component is made with: the one signature, what is pending after its effects, and a replica of the map."""
