"""The fourteen machines."""

from benchmarks.unseen.machine import Machine
from benchmarks.unseen.machines.arms import EXCAVATOR, FINGER, LEG, POLAR, SEVEN
from benchmarks.unseen.machines.linear import LIFT, TROLLEY, WHEEL
from benchmarks.unseen.machines.rotary import ANTENNA, DOOR, GIMBAL, VALVE
from benchmarks.unseen.machines.swinging import HIP, REACTION

MACHINES: dict[str, Machine] = {
    m.name: m
    for m in (ANTENNA, FINGER, EXCAVATOR, VALVE, LEG, LIFT, REACTION, HIP, GIMBAL, SEVEN, WHEEL, POLAR, TROLLEY, DOOR)
}
