"""Least squares that takes rows as they come and forgets old ones."""

from dynident.identification.recursive.recursive_least_squares import RecursiveLeastSquares as RecursiveLeastSquares
