"""The Service Manager as a component: it joins one device to the system and takes part in transactions for the device's services."""
