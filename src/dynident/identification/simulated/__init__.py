"""Estimators that simulate the closed loop: reference, controller, exact derivatives, instruments."""
