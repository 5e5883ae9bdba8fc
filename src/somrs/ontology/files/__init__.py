"""Ontologies and maps as YAML files: read, checked, written."""
