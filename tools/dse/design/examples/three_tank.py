"""Three coupled tanks: section 6 of the adaptive high-gain source, in CasADi.

The differences of the levels are states of their own, x2 = L1 - L2 and x4 = L3 - L2, and the signs
of the flows between tanks are dropped: they run towards tank 2 (eq 6.6-6.8). The pump flows enter f
affinely and stay out of the coordinates.
"""

import casadi as ca

from dse.design.plant_file import Parameter, ParameterSet, Signal, Subsystem

name = "three_tank"
title = "three coupled tanks"
source = "adaptive high-gain EKF, sections 6.2 and 6.3, eq 6.1-6.8"
time_unit = "h"
time_unit_s = 3600

states = [
    Signal("x1", "cm", 51.08, 5, "level of tank 1"),
    Signal("x2", "cm", 35.03, 5, "level of tank 1 above tank 2"),
    Signal("x3", "cm", 16.05, 5, "level of tank 2"),
    Signal("x5", "cm", 56.93, 5, "level of tank 3"),
    Signal("x4", "cm", 40.88, 5, "level of tank 3 above tank 2"),
]
inputs = [
    Signal("u1", "", 7.286216517786794, 1, "pump into tank 1"),
    Signal("u2", "", 8.791727762795189, 1, "pump into tank 3"),
]
inputs_in_map = False
outputs = [
    Signal("y1", "cm", 51.08, 5, "measured level of tank 1"),
    Signal("y2", "cm", 16.05, 5, "measured level of tank 2"),
    Signal("y3", "cm", 56.93, 5, "measured level of tank 3"),
]
subsystems = [
    Subsystem("tank 1", ["x1", "x2"], ["y1"]),
    Subsystem("tank 2", ["x3"], ["y2"]),
    Subsystem("tank 3", ["x5", "x4"], ["y3"]),
]

parameters = [
    Parameter("ap1", "s/min", 0, 1e3, "outflow coefficient, pipe from tank 1 to 2"),
    Parameter("ap2", "s/min", 0, 1e3, "outflow coefficient, pipe from tank 3 to 2"),
    Parameter("ad1", "s/min", 0, 1e3, "outflow coefficient, drain of tank 1"),
    Parameter("ad2", "s/min", 0, 1e3, "outflow coefficient, drain of tank 2"),
    Parameter("ad3", "s/min", 0, 1e3, "outflow coefficient, drain of tank 3"),
    Parameter("b1", "m3/min", 0, 1, "flow per unit of u1"),
    Parameter("b2", "m3/min", 0, 1, "flow per unit of u2"),
    Parameter("S", "cm2", 1e-3, 1e6, "cross-section of a tank"),
    Parameter("Sp", "cm2", 0, 1e6, "cross-section of a pipe between tanks"),
    Parameter("Sd", "cm2", 0, 1e6, "cross-section of a drain"),
    Parameter("g", "cm/s2", 1e-3, 1e4, "gravity"),
]
x0 = {"x1": 51.08, "x2": 35.03, "x3": 16.05, "x5": 56.93, "x4": 40.88}
common = {
    **{"ap1": 3.43, "ap2": 3.43, "ad1": 18.15, "ad3": 18.98, "b1": 4.56e-4, "b2": 4.16e-4},
    **{"S": 154, "Sp": 0.5, "Sd": 0.5, "g": 981},
}
sets = [
    ParameterSet("identified", "eq 6.5", {**common, "ad2": 7.78}, x0),
    ParameterSet("rig", "at rest in the initial state", {**common, "ad2": 10.541392035982543}, x0),
]


def f(t, x, u, p):
    """Balances of volume, cm/h."""
    speed = 60 * ca.sqrt(2 * p.g) / p.S
    p1, p2 = (speed * p.Sp * a for a in (p.ap1, p.ap2))
    d1, d2, d3 = (speed * p.Sd * a for a in (p.ad1, p.ad2, p.ad3))
    dx1 = 60e6 * p.b1 / p.S * u.u1 - p1 * ca.sqrt(x.x2) - d1 * ca.sqrt(x.x1)
    dx3 = p1 * ca.sqrt(x.x2) + p2 * ca.sqrt(x.x4) - d2 * ca.sqrt(x.x3)
    dx5 = 60e6 * p.b2 / p.S * u.u2 - p2 * ca.sqrt(x.x4) - d3 * ca.sqrt(x.x5)
    return {"x1": dx1, "x2": dx1 - dx3, "x3": dx3, "x5": dx5, "x4": dx5 - dx3}


def h(t, x, u, p):
    """Levels are measured."""
    return {"y1": x.x1, "y2": x.x3, "y3": x.x5}


def domain(t, x, u, p):
    """No tank is empty and all flows run towards tank 2."""
    return [x.x1, x.x2, x.x3, x.x5, x.x4]
