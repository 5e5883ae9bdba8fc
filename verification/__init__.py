"""Evidence that the system keeps its guarantees: model check, fault runs, kill runs, upgrades, mutants and published problems."""
