"""Searches of a box by many points, the objectives they see, and the certified optimum beside them."""
