"""Ontologies and maps: definitions, objects and facts, and the evaluation of formulas on them."""
