"""Payload: mass, centre of mass and inertia of a tool or load from a run with it, with intervals and verdicts."""

from dynident.applications.payload.carried_load import CarriedLoad as CarriedLoad
from dynident.applications.payload.carried_load import LoadParameter as LoadParameter
from dynident.applications.payload.identify_payload import BeforeRun as BeforeRun
from dynident.applications.payload.identify_payload import identify_payload as identify_payload
from dynident.applications.payload.vendor_forms import vendor_forms as vendor_forms
