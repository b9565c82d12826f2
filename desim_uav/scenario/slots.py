"""Slots of a scenario for components, each with its default kind and its Protocol."""

from __future__ import annotations

import desim_uav.model
import desim_uav.rules
from desim_uav import registry
from desim_uav.model.admission import Admission
from desim_uav.model.association import Association
from desim_uav.model.backhaul import Backhaul
from desim_uav.model.decisions import Decisions
from desim_uav.model.demand.demand import Demand, Sensed
from desim_uav.model.energy.battery import Energy
from desim_uav.model.energy.charging import Charging
from desim_uav.model.mobility.mobility import Mobility
from desim_uav.model.motion.motion import Motion
from desim_uav.model.observations import Encoding
from desim_uav.model.offloading import RowOffloading
from desim_uav.model.processing import RowProcessing
from desim_uav.model.radio.radio import Radio
from desim_uav.model.rewards import Reward
from desim_uav.model.services import Service
from desim_uav.scenario.components import Slot

registry.discover(desim_uav.model, deep=True)
registry.discover(desim_uav.rules)

MOTION = Slot("motion", "bang_coast_bang", Motion)
BATTERY = Slot("battery", "endurance", Energy)
CHARGING = Slot("charging", "constant", Charging)
ADMISSION = Slot("admission", "first_come", Admission)
MOBILITY = Slot("mobility", "random_walk", Mobility)
DEMAND = Slot("demand", "dynamic", Demand | Sensed)
REWARD = Slot("reward", "qoe", Reward)
OBSERVATION = Slot("observation", "position", Encoding)
RADIO = Slot("radio", "disc", Radio)
LINKS = Slot("radio", "link_classes", Radio)
ASSOCIATION = Slot("association", "entered_first", Association, by_name=True)
DECISIONS = Slot("decisions", "clock", Decisions, by_name=True)
OFFLOADING = Slot("offloading", "always", RowOffloading, by_name=True)
PROCESSING = Slot("processing", "first_come", RowProcessing, by_name=True)
BACKHAUL = Slot("backhaul", "capacity", Backhaul)
SERVICE = Slot("service", "uniform_choice", Service)
