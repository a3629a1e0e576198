"""The design of an excitation: bounds, the optimisation problem, the search, and the plan."""
