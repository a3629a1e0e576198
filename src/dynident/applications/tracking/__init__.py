"""Tracking: parameters that drift, and loads and friction that change at once, on the rows of a moving robot."""

from dynident.applications.tracking.tracked_log import Event as Event
from dynident.applications.tracking.tracked_log import Tracked as Tracked
from dynident.applications.tracking.tracked_log import thresholds_of as thresholds_of
from dynident.applications.tracking.tracked_log import tracked as tracked
from dynident.applications.tracking.tracker import Pace as Pace
from dynident.applications.tracking.tracker import Tracker as Tracker
