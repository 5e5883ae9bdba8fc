"""Planning problems, operators, plans and their causal links."""
