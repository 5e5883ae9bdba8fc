"""The Service Manager as a component: a participant of transactions, joined to the Registry, with one device to run."""
