"""What is exported: an identified model with possible bodies, and the states on which it is proved."""
