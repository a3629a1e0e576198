"""Motions for identification: trajectories, criteria, limits, collision, and the search for the best one."""
