"""The Service Managers of the simulated robots and cameras."""
