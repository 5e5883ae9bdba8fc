"""Arrangement, from an abstract plan to contracts: the plan, available services, calls for proposals (paper, "SO-MRS architecture")."""
