"""The numeric core: one recursion, a generic compiled form of it and one generated per robot."""
