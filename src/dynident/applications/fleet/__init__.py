"""Fleets: many robots of one type, each estimate with what the others tell about its type."""

from dynident.applications.fleet.fleet import Fleet as Fleet
from dynident.applications.fleet.fleet import fleet_of as fleet_of
from dynident.applications.fleet.robots import FleetRobot as FleetRobot
from dynident.applications.fleet.robots import robot_of_digest as robot_of_digest
from dynident.applications.fleet.robots import robot_of_estimate as robot_of_estimate
