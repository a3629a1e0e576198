"""The rehearsal: what a planned run would tell about a robot, on a virtual robot whose truth is known."""
