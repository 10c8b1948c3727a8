"""Four stirred tanks with two recycles: the plant that dse ships as cstr4, in CasADi.

Section 3.7, eq 3.65, Table 3.1 of the adaptive high-gain source. No input varies. A plant of many
alike units is written with loops.
"""

import casadi as ca

from dse.design.plant_file import Parameter, ParameterSet, Signal, Subsystem

name = "cstr4"
title = "four stirred tanks with two recycles"
source = "adaptive high-gain EKF, section 3.7, eq 3.65, Table 3.1"
time_unit = "h"
time_unit_s = 3600

REACTORS = (1, 2, 3, 4)
REACTIONS = (1, 2, 3)
x0 = {"T1": 340, "C1": 2, "T2": 350, "C2": 3, "T3": 345, "C3": 2.5, "T4": 360, "C4": 4}

states = [
    signal
    for i in REACTORS
    for signal in (
        Signal(f"T{i}", "K", x0[f"T{i}"], 10, f"temperature of reactor {i}"),
        Signal(f"C{i}", "kmol/m3", x0[f"C{i}"], 1, f"concentration of A in reactor {i}"),
    )
]
outputs = [
    Signal(f"y{i}", "K", x0[f"T{i}"], 10, f"measured temperature of reactor {i}") for i in REACTORS
]
subsystems = [Subsystem(f"reactor {i}", [f"T{i}", f"C{i}"], [f"y{i}"]) for i in REACTORS]

parameters = [
    *(Parameter(f"V{i}", "m3", 1e-6, 1e6, f"volume of reactor {i}") for i in REACTORS),
    *(Parameter(f"F0{i}", "m3/h", 0, 1e6, f"feed flow into reactor {i}") for i in REACTORS),
    *(Parameter(f"T0{i}", "K", 200, 1000, f"temperature of feed F0{i}") for i in REACTORS),
    *(Parameter(f"CA0{i}", "kmol/m3", 0, 1000, f"concentration of feed F0{i}") for i in REACTORS),
    *(Parameter(f"Qh{i}", "kJ/h", -1e9, 1e9, f"heat into reactor {i}") for i in REACTORS),
    Parameter("Fr1", "m3/h", 0, 1e6, "recycle flow from reactor 2 to 1"),
    Parameter("Fr2", "m3/h", 0, 1e6, "recycle flow from reactor 4 to 1"),
    Parameter("rho", "kg/m3", 1, 1e5, "density"),
    Parameter("cp", "kJ/(kg K)", 1e-3, 1e2, "specific heat"),
    Parameter("R", "kJ/(kmol K)", 8, 9, "gas constant"),
    *(Parameter(f"dH{i}", "kJ/kmol", -1e7, -1e-3, f"enthalpy of reaction {i}") for i in REACTIONS),
    Parameter("k10", "1/h", 1e-3, 1e15, "rate constant of reaction 1"),
    Parameter("k20", "1/h", 0, 1e15, "rate constant of reaction 2"),
    Parameter("k30", "1/h", 0, 1e15, "rate constant of reaction 3"),
    *(
        Parameter(f"E{i}", "kJ/kmol", 1, 1e6, f"activation energy of reaction {i}")
        for i in REACTIONS
    ),
]
sets = [
    ParameterSet(
        "ch3",
        "section 3.7, Table 3.1; the same in section 5.7",
        {
            **{"V1": 1, "V2": 3, "V3": 4, "V4": 6, "F01": 5, "F02": 10, "F03": 8, "F04": 12},
            **{"T01": 300, "T02": 300, "T03": 300, "T04": 300},
            **{"CA01": 4, "CA02": 2, "CA03": 3, "CA04": 3.5},
            **{"Qh1": 1e4, "Qh2": 2e4, "Qh3": 2.5e4, "Qh4": 1e4, "Fr1": 20, "Fr2": 10},
            **{"rho": 1000, "cp": 0.231, "R": 8.314},
            **{"dH1": -5.0e4, "dH2": -5.2e4, "dH3": -5.04e4},
            **{"k10": 3.0e6, "k20": 3.0e5, "k30": 3.0e5, "E1": 5.0e4, "E2": 7.53e4, "E3": 7.53e4},
        },
        x0,
    )
]


def f(t, x, u, p):
    """Balances of heat and of A; what flows into a reactor flows out of it."""
    F1 = p.F01 + p.Fr1 + p.Fr2
    F2 = F1 + p.F02
    F3 = F2 - p.Fr1 + p.F03
    links = {1: [(2, p.Fr1), (4, p.Fr2)], 2: [(1, F1)], 3: [(2, F2 - p.Fr1)], 4: [(3, F3)]}
    derivative = {}
    for i in REACTORS:
        T, C, V, rho_cp = x[f"T{i}"], x[f"C{i}"], p[f"V{i}"], p.rho * p.cp
        rates = [p[f"k{j}0"] * ca.exp(-p[f"E{j}"] / p.R / T) * C for j in REACTIONS]
        heat = sum(-p[f"dH{j}"] * rate for j, rate in zip(REACTIONS, rates, strict=True))
        warm = p[f"F0{i}"] * (p[f"T0{i}"] - T) + sum(F * (x[f"T{j}"] - T) for j, F in links[i])
        rich = p[f"F0{i}"] * (p[f"CA0{i}"] - C) + sum(F * (x[f"C{j}"] - C) for j, F in links[i])
        derivative[f"T{i}"] = warm / V + heat / rho_cp + p[f"Qh{i}"] / (rho_cp * V)
        derivative[f"C{i}"] = rich / V - sum(rates)
    return derivative


def h(t, x, u, p):
    """Temperatures are measured."""
    return {f"y{i}": x[f"T{i}"] for i in REACTORS}


def domain(t, x, u, p):
    """Absolute temperatures are positive."""
    return [x[f"T{i}"] for i in REACTORS]
