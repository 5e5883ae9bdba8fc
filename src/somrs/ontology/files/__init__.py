"""Ontologies and maps as YAML files: reading, checking and writing."""
