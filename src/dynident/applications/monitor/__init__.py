"""Monitor: torques from outside by a momentum observer, and alarms at a rate that the user chooses."""

from dynident.applications.monitor.live import watch as watch
from dynident.applications.monitor.momentum_observer import MomentumObserver as MomentumObserver
from dynident.applications.monitor.monitor import Alarm as Alarm
from dynident.applications.monitor.monitor import Monitor as Monitor
from dynident.applications.monitor.monitor import MonitorSample as MonitorSample
from dynident.applications.monitor.monitor import MonitorState as MonitorState
from dynident.applications.monitor.monitor import calibrated as calibrated
from dynident.applications.monitor.monitor import step as step
from dynident.applications.monitor.monitored_log import Monitored as Monitored
from dynident.applications.monitor.monitored_log import run_monitor as run_monitor
