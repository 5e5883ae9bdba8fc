"""The paper's scenarios, played by a whole system."""
