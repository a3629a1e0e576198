"""Drive gains: joint torque per ampere of each motor, from logs of currents, with intervals and verdicts."""

from dynident.estimation.drive_gains.drive_gains import DriveGain as DriveGain
from dynident.estimation.drive_gains.drive_gains import DriveGains as DriveGains
from dynident.estimation.drive_gains.identify_gains import gains_from_payload as gains_from_payload
from dynident.estimation.drive_gains.identify_gains import gains_from_prior as gains_from_prior
from dynident.estimation.drive_gains.methods import METHODS as METHODS
from dynident.estimation.drive_gains.payload import Payload as Payload
