"""Tracking: parameters that drift, and loads and friction that change at once, on the rows of a moving robot."""

from dynident.estimation.tracking.tracked_log import Event as Event
from dynident.estimation.tracking.tracked_log import Tracked as Tracked
from dynident.estimation.tracking.tracked_log import thresholds_of as thresholds_of
from dynident.estimation.tracking.tracked_log import tracked as tracked
from dynident.estimation.tracking.tracker import Pace as Pace
from dynident.estimation.tracking.tracker import Tracker as Tracker
