"""Drive gains: joint torque per ampere of each motor, from logs of currents, with intervals and verdicts."""

from dynident.applications.drive_gains.drive_gains import DriveGain as DriveGain
from dynident.applications.drive_gains.drive_gains import DriveGains as DriveGains
from dynident.applications.drive_gains.gain_solve import GainOptions as GainOptions
from dynident.applications.drive_gains.identify_gains import gains_from_payload as gains_from_payload
from dynident.applications.drive_gains.identify_gains import gains_from_prior as gains_from_prior
from dynident.applications.drive_gains.methods import METHODS as METHODS
from dynident.applications.drive_gains.payload import CarriedBody as CarriedBody
