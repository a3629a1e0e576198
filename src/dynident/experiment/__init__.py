"""The experiment: trajectories, logs, preprocessing, the case file, the virtual robot."""
