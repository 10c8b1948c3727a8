"""Two stirred tanks with recycle: the plant that dse ships as cstr2, in CasADi.

Section 2.6, eq 2.59, Table 2.1 of the adaptive high-gain source. The feed F0 is a known input and
dF0 its time derivative, so that the coordinates follow a feed that varies between samples.
"""

import casadi as ca

from dse.design.plant_file import Parameter, ParameterSet, Signal, Subsystem

name = "cstr2"
title = "two stirred tanks with recycle"
source = "adaptive high-gain EKF, section 2.6, eq 2.59, Table 2.1"
time_unit = "h"
time_unit_s = 3600

states = [
    Signal("T1", "K", 360, 10, "temperature of reactor 1"),
    Signal("C1", "kmol/m3", 3, 1, "concentration of A in reactor 1"),
    Signal("T2", "K", 320, 10, "temperature of reactor 2"),
    Signal("C2", "kmol/m3", 2.5, 1, "concentration of A in reactor 2"),
]
inputs = [
    Signal("F0", "m3/h", 4.998, 1, "feed flow into reactor 1"),
    Signal("dF0", "m3/h2", 0, 100, "time derivative of the feed flow F0"),
]
rates = {"F0": "dF0"}
outputs = [
    Signal("y1", "K", 360, 10, "measured temperature of reactor 1"),
    Signal("y2", "K", 320, 10, "measured temperature of reactor 2"),
]
subsystems = [
    Subsystem("reactor 1", ["T1", "C1"], ["y1"]),
    Subsystem("reactor 2", ["T2", "C2"], ["y2"]),
]

parameters = [
    Parameter("V1", "m3", 1e-6, 1e6, "volume of reactor 1"),
    Parameter("V2", "m3", 1e-6, 1e6, "volume of reactor 2"),
    Parameter("T0", "K", 200, 1000, "temperature of feed F0"),
    Parameter("CA0", "kmol/m3", 0, 1000, "concentration of feed F0"),
    Parameter("F3", "m3/h", 0, 1e6, "feed flow into reactor 2"),
    Parameter("T03", "K", 200, 1000, "temperature of feed F3"),
    Parameter("CA03", "kmol/m3", 0, 1000, "concentration of feed F3"),
    Parameter("Fr", "m3/h", 0, 1e6, "recycle flow from reactor 2 to 1"),
    Parameter("dFr", "m3/h", -1e3, 1e3, "model mismatch: surplus of Fr into reactor 1 only"),
    Parameter("Qh1", "kJ/h", -1e9, 1e9, "heat into reactor 1"),
    Parameter("Qh2", "kJ/h", -1e9, 1e9, "heat into reactor 2"),
    Parameter("rho", "kg/m3", 1, 1e5, "density"),
    Parameter("cp", "kJ/(kg K)", 1e-3, 1e2, "specific heat"),
    Parameter("R", "kJ/(kmol K)", 8, 9, "gas constant"),
    Parameter("dH1", "kJ/kmol", -1e7, -1e-3, "enthalpy of reaction 1"),
    Parameter("dH2", "kJ/kmol", -1e7, -1e-3, "enthalpy of reaction 2"),
    Parameter("dH3", "kJ/kmol", -1e7, -1e-3, "enthalpy of reaction 3"),
    Parameter("k10", "1/h", 1e-3, 1e15, "rate constant of reaction 1"),
    Parameter("k20", "1/h", 0, 1e15, "rate constant of reaction 2"),
    Parameter("k30", "1/h", 0, 1e15, "rate constant of reaction 3"),
    Parameter("E1", "kJ/kmol", 1, 1e6, "activation energy of reaction 1"),
    Parameter("E2", "kJ/kmol", 1, 1e6, "activation energy of reaction 2"),
    Parameter("E3", "kJ/kmol", 1, 1e6, "activation energy of reaction 3"),
]

common = {
    **{"V1": 1.0, "V2": 3.0, "T0": 300, "CA0": 4.0, "F3": 30.0, "T03": 300, "CA03": 2.0},
    **{"Fr": 34.998, "dFr": 0, "rho": 1000, "cp": 0.231, "R": 8.314},
    **{"dH1": -5.0e4, "dH2": -5.2e4, "dH3": -5.04e4},
    **{"k10": 3.0e6, "k20": 3.0e5, "k30": 3.0e5, "E1": 5.0e4, "E2": 7.53e4, "E3": 7.53e4},
}
sets = [
    ParameterSet(
        "ch2",
        "section 2.6, Table 2.1",
        {**common, "Qh1": 1.8e4, "Qh2": 1.2e4},
        {"T1": 360, "C1": 3, "T2": 320, "C2": 2.5},
    ),
    ParameterSet(
        "ch4",
        "section 4.7",
        {**common, "Qh1": 1.4e4, "Qh2": 1.4e4},
        {"T1": 360, "C1": 3, "T2": 320, "C2": 3},
    ),
]
points = {
    "cold steady state": {"T1": 305.715512, "C1": 2.497447, "T2": 304.172640, "C2": 2.283483},
    "filter's guess": {"T1": 396, "C1": 2.6, "T2": 352, "C2": 10.5},
}


def reactions(T, p):
    """Heat R_h (K/h per kmol/m3) and rate r (1/h) of the three parallel reactions."""
    k = [p[f"k{i}0"] * ca.exp(-p[f"E{i}"] / p.R / T) for i in (1, 2, 3)]
    heat = [-p[f"dH{i}"] / (p.rho * p.cp) for i in (1, 2, 3)]
    return sum(q * rate for q, rate in zip(heat, k, strict=True)), sum(k)


def f(t, x, u, p):
    """Balances of heat and of A; F1 = F0 + Fr leaves reactor 1."""
    heat1, rate1 = reactions(x.T1, p)
    heat2, rate2 = reactions(x.T2, p)
    F1, recycle, rho_cp = u.F0 + p.Fr, p.Fr + p.dFr, p.rho * p.cp
    return {
        "T1": u.F0 / p.V1 * (p.T0 - x.T1)
        + recycle / p.V1 * (x.T2 - x.T1)
        + heat1 * x.C1
        + p.Qh1 / (rho_cp * p.V1),
        "C1": u.F0 / p.V1 * (p.CA0 - x.C1) + recycle / p.V1 * (x.C2 - x.C1) - rate1 * x.C1,
        "T2": F1 / p.V2 * (x.T1 - x.T2)
        + p.F3 / p.V2 * (p.T03 - x.T2)
        + heat2 * x.C2
        + p.Qh2 / (rho_cp * p.V2),
        "C2": F1 / p.V2 * (x.C1 - x.C2) + p.F3 / p.V2 * (p.CA03 - x.C2) - rate2 * x.C2,
    }


def h(t, x, u, p):
    """Temperatures are measured."""
    return {"y1": x.T1, "y2": x.T2}


def domain(t, x, u, p):
    """Absolute temperatures are positive."""
    return [x.T1, x.T2]
