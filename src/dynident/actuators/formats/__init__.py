"""Log formats of servos alone: parts of the family of dynident.data.formats."""
