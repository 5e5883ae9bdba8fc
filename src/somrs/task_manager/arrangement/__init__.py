"""From an abstract plan to contracts: which services there are, whom to ask, and whose terms to take (paper, "SO-MRS architecture")."""
