"""From a planning problem to a finite-domain task: relevance analysis, grounding and mutex groups."""
