"""`make traffic-runs`: many robots on random roadmaps, with delays, breakdowns and kills, on virtual time."""
