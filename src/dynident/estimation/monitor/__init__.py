"""Monitor: torques from outside by a momentum observer, and alarms at a rate that the user chooses."""

from dynident.estimation.monitor.live import watch as watch
from dynident.estimation.monitor.momentum_observer import MomentumObserver as MomentumObserver
from dynident.estimation.monitor.monitor import Alarm as Alarm
from dynident.estimation.monitor.monitor import Monitor as Monitor
from dynident.estimation.monitor.monitor import MonitorState as MonitorState
from dynident.estimation.monitor.monitor import Reading as Reading
from dynident.estimation.monitor.monitor import calibrated as calibrated
from dynident.estimation.monitor.monitor import step as step
from dynident.estimation.monitor.monitored_log import Monitored as Monitored
from dynident.estimation.monitor.monitored_log import run_monitor as run_monitor
