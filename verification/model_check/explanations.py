"""Why some alterations of the tables change nothing that a property asks for."""

from __future__ import annotations

EXPLANATIONS: dict[tuple[str, str, str, str], str] = {}
