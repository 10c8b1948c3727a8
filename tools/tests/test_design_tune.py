"""dse design tune: sweeps, their numbers, and what they say about a filter's gain."""

import csv
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import Command

from dse.design import flowchart
from dse.design.flowchart import measure, noise_innovation, reached, resting_gain, step_of
from dse.design.sweep import Variation, cases, find_program, settings
from dse.design.tune import overrides
from dse.errors import UserError
from dse.log import read

HERE = Path(__file__).parent
SCENARIO = """
name: synthetic
time: {period_s: 1, duration_s: 200}
noise:
  process: {distribution: gaussian, scale: [60, 1, 30, 1]}
  measurement: {distribution: uniform, scale: [3, 1.5]}
networks:
  - name: ahg
    high_gain_ekf: &tuning {gain: adaptive, innovation: sum, d: 0.02, DeltaT: 0.001, beta: 5, m: 4,
                            lambda: 100, theta_m: 20}
  - name: ekf
    high_gain_ekf: {<<: *tuning, gain: one}
"""
# A dse-run that writes a made-up log: its noise is what --set networks[..].R says.
FAKE = f"""#!{sys.executable}
import argparse, sys
sys.path[:0] = [{str(HERE)!r}]
import synthetic
parser = argparse.ArgumentParser()
parser.add_argument("scenario")
parser.add_argument("--log")
parser.add_argument("--set", action="append", default=[])
parser.add_argument("--seed", type=int, default=7)
parser.add_argument("--inproc", action="store_true")
parser.add_argument("--quiet", action="store_true")
o = parser.parse_args()
if o.scenario != "two-reactors":
    sys.exit("dse-run: no scenario is called " + o.scenario)
plant, node = synthetic.plant_info, synthetic.node_info
def plant_info(plan):
    info = plant(plan)
    info["scenario"].update(yaml={SCENARIO!r}, overrides=o.set)
    return info
def node_info(plan, network, n):
    info = node(plan, network, n)
    names = [d["name"] for d in info["diagnostics"]]
    if "J" in names:
        info["diagnostics"][names.index("J")]["name"] = "J driving theta"
    return info
synthetic.plant_info, synthetic.node_info = plant_info, node_info
R = [float(s.split("=")[1]) for s in o.set if s.startswith("networks[ahg].high_gain_ekf.R=")]
synthetic.write(o.log, synthetic.Plan(seed=o.seed, noise=0.05 * (R or [1.0])[0]))
"""


@pytest.fixture
def fake(tmp_path: Path) -> Path:
    path = tmp_path / "bin" / "dse-run"
    path.parent.mkdir()
    path.write_text(FAKE)
    path.chmod(0o755)
    return path


# ---- sweeps


def test_commas_within_brackets_belong_to_a_value() -> None:
    found = Variation.parse("Q=[150, 5],[50,5],{a: 1, b: [2,3]}")
    assert found == Variation("Q", ("[150, 5]", "[50,5]", "{a: 1, b: [2,3]}"))
    assert Variation.parse("a.b=x=1,y").values == ("x=1", "y")
    for bad in ("Q", "Q=", "=1", "Q=1,,2", "Q=[1,2"):
        with pytest.raises(UserError, match="expected KEY=VALUE"):
            Variation.parse(bad)


def test_all_combinations_are_run() -> None:
    found = cases([Variation("a", ("1", "2")), Variation("b", ("x", "y"))])
    assert [tuple(v for _, v in case) for case in found] == [
        *(("1", "x"), ("1", "y")),
        *(("2", "x"), ("2", "y")),
    ]


def test_short_keys_mean_all_high_gain_networks() -> None:
    case = (("m", "4"), ("time.duration_s", "60"), ("communication.every", "9"))
    assert overrides(case, ["ahg", "ekf"]) == (
        "networks[ahg].high_gain_ekf.m=4",
        "networks[ekf].high_gain_ekf.m=4",
        "time.duration_s=60",
        "networks[ahg].high_gain_ekf.communication.every=9",
        "networks[ekf].high_gain_ekf.communication.every=9",
    )


def test_settings_are_the_scenario_with_its_overrides(fake: Path, tmp_path: Path) -> None:
    log = tmp_path / "a.lcm"
    changes = [
        "networks[ahg].high_gain_ekf.m=7",
        "networks[1].high_gain_ekf.d=0.5",
        "noise.x=[1, 2]",
    ]
    words = [word for change in changes for word in ("--set", change)]
    assert (
        os.spawnv(os.P_WAIT, str(fake), [str(fake), "two-reactors", "--log", str(log), *words]) == 0
    )
    tree = settings(read(log))
    first, second = (one["high_gain_ekf"] for one in tree["networks"])
    assert (first["m"], first["d"], second["m"], second["d"]) == (7, 0.02, 4, 0.5)
    assert tree["noise"]["x"] == [1, 2] and second["gain"] == "one"


def test_program_is_found_where_it_is_said_to_be(
    fake: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert find_program(str(fake)) == find_program(str(fake.parent)) == str(fake)
    monkeypatch.setenv("PATH", str(fake.parent))
    assert find_program(None) == str(fake)
    for bad in (tmp_path, tmp_path / "nothing"):
        with pytest.raises(UserError, match="there is no program"):
            find_program(str(bad))


# ---- numbers


def simulate_gain(J: float, beta: float, m: float, relax: float, theta_m: float) -> float:
    """The gain in the end, from 2 theta_m; lambda = relax, DeltaT = 1, small Euler steps."""
    theta, mu = 2 * theta_m, 1 / (1 + np.exp(-beta * (J - m)))
    for _ in range(20_000):
        away = theta if theta <= theta_m else theta - 2 * theta_m
        theta += 1e-3 / relax * (mu * away**2 + (1 - mu) * relax * (1 - theta))
    return float(theta)


@pytest.mark.parametrize("exponent", [-12.0, -6.0, -5.2, -4.9, -4.0, -1.0])
def test_gain_rests_under_noise_where_its_equation_does(exponent: float) -> None:
    relax, theta_m = 0.1, 20.0
    expected = resting_gain(exponent, relax, theta_m)
    simulated = simulate_gain(0.5, -exponent / 0.5, 1.0, relax, theta_m)
    if np.isinf(expected):
        assert simulated > theta_m
    else:
        assert simulated == pytest.approx(expected, rel=1e-3)


def test_gain_stays_high_exactly_from_the_limit_on() -> None:
    # r theta_m^2 = theta_m - 1 with r = exp(e)/relax
    limit = np.log(0.1 * 19 / 400)
    assert np.isfinite(resting_gain(limit - 1e-6, 0.1, 20)) and np.isinf(
        resting_gain(limit + 1e-6, 0.1, 20)
    )
    assert np.isinf(resting_gain(-50, 0.0, 20))  # lambda = 0: nothing brings it back


def test_noise_innovation_is_what_noise_makes_of_a_drifting_output(
    fake: Path, tmp_path: Path
) -> None:
    log = tmp_path / "a.lcm"
    assert os.spawnv(os.P_WAIT, str(fake), [str(fake), "two-reactors", "--log", str(log)]) == 0
    run = read(log)
    tree, d, T = settings(run), 0.02, 1 / 3600
    generator = np.random.default_rng(1)
    N, trials = round(d / T), 20_000
    for node, scale, bound in zip(run.networks[0].nodes, (60, 30), (3, 1.5), strict=True):
        # y' = w, held over a sample; predicted from the truth at t - d: it stays
        drift = np.cumsum(scale * T * generator.standard_normal((trials, N)), axis=1)
        drift = np.hstack([np.zeros((trials, 1)), drift])
        square = (drift + generator.uniform(-bound, bound, drift.shape)) ** 2
        J = T * (square.sum(axis=1) - 0.5 * (square[:, 0] + square[:, -1]))
        assert noise_innovation(run, node, tree, d) == pytest.approx(J.mean(), rel=0.02)


def test_reached_is_the_first_stretch_below_a_tenth() -> None:
    time = np.arange(1000.0)
    norm = 5 * np.exp(-time / 100)
    norm[[20, 50]] = 0  # lucky samples
    assert reached(time, norm) == pytest.approx(100 * np.log(10) - 10, abs=3)
    assert reached(time, np.full(1000, 2.0)) == np.inf
    assert reached(time[:0], norm[:0]) == np.inf


def test_roughness_leaves_out_what_is_slow(plain: Path) -> None:
    run = read(plain)
    generator = np.random.default_rng(1)
    noise = generator.standard_normal((200, 4)) * (0.1, 0.2, 0.3, 0.4)
    slow = 5 + np.linspace(0, 3, 200)[:, None]
    found = flowchart.roughness(run, slow + noise)
    assert found == pytest.approx(np.array([0.1, 0.2, 0.3, 0.4]), rel=0.3)
    assert flowchart.roughness(run, slow + 2 * noise) == pytest.approx(2 * found, rel=1e-2)


def test_each_network_belongs_to_a_step_of_the_flowchart() -> None:
    assert [step_of(gain, ["theta_m"]) for gain in ("one", "permanent", "adaptive", "-")] == [
        *(1, 2, 4, None)
    ]
    assert step_of("adaptive", ["d"]) == step_of("adaptive", ["networks[0].high_gain_ekf.d"]) == 3
    assert flowchart.gain_of({"gains": ["adaptive", "one"]}) == "adaptive"
    assert flowchart.gain_of({"gains": ["permanent", "one"]}) == "mixed"
    assert flowchart.gain_of({}) == "adaptive" and flowchart.gain_of(None) == "-"


# ---- the command


def test_command_shows_steps_noise_and_room_for_m(dse: Command, fake: Path, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    words = ("--vary", "R=1,4", "--seeds", 2, "--bin", fake, "-o", folder)
    done = dse("design", "tune", "two-reactors", *words)
    assert done.code == 0, done.err
    assert "ahg: 4. gain at work" in done.out and "ekf: 1. theta = 1" in done.out
    # J_noise = sum over both nodes of d sigma^2 + s^2 T d^2/2
    noise = 0.02 * (3 + 0.75) + (3600 + 900) / 3600 * 0.02**2 / 2
    assert f"{noise:.4g}" in done.out and f"{3 * noise:.4g} to {47 / 3:.4g}" in done.out
    for name in ("tune.png", "gain.png"):
        assert (folder / name).read_bytes().startswith(b"\x89PNG")
    with (folder / "tune.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["seed"] for row in rows} == {"1", "2"}
    assert {row["state"] for row in rows} == {"error norm", "T1", "C1", "T2", "C2"}
    rough = {
        row["R"]: float(row["noise"])
        for row in rows
        if (row["network"], row["state"], row["seed"]) == ("ahg", "T2", "1")
    }
    assert rough["4"] == pytest.approx(4 * rough["1"], rel=0.05)
    assert rough["1"] == pytest.approx(0.05, rel=0.3)


def test_command_keeps_to_the_network_that_is_asked_for(dse: Command, fake: Path) -> None:
    words = ("--vary", "gain=adaptive", "--network", "ahg", "--bin", fake)
    done = dse("design", "tune", "two-reactors", *words)
    assert done.code == 0 and "ahg: 4." in done.out and "ekf" not in done.out


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("two-reactors",), "at least one --vary"),
        (("two-reactors", "--vary", "m"), "expected KEY=VALUE"),
        (("two-reactors", "--vary", "m=1", "--seeds", "0"), "must be at least 1"),
        (("two-reactors", "--vary", "m=1", "--network", "ahh"), "did you mean ahg"),
        (("three-reactors", "--vary", "m=1"), "no scenario is called three-reactors"),
    ],
)
def test_mistakes_are_told_in_one_line(
    dse: Command, fake: Path, words: tuple[str, ...], told: str
) -> None:
    done = dse("design", "tune", *words, "--bin", fake)
    assert done.code == 2 and told in done.err and len(done.err.splitlines()) == 1


def test_real_filter_keeps_its_gain_up_when_m_and_beta_let_noise_do_so(tmp_path: Path) -> None:
    from dse.design.sweep import Job, run_all

    try:
        program = find_program(None)
    except UserError:
        pytest.skip("dse-run is not built")
    short = ("time.duration_s=600", "networks[ahg].high_gain_ekf.communication.kind=tick")
    jobs = [Job("ahg-43", (*short, f"networks[ahg].high_gain_ekf.m={m}"), 1) for m in (0.5, 4)]
    soft, firm = (networks[0] for networks in run_all(program, jobs, measure))
    assert soft.innovation is not None and firm.innovation is not None
    assert np.isinf(soft.innovation.rest) and soft.high > 0.9
    assert firm.innovation.rest < 1.01 and firm.high < 0.3
    assert firm.theta[-1].max() == pytest.approx(firm.innovation.rest, abs=0.01)
    # J of a filter that has arrived is about that of noise alone
    assert 0.3 < soft.innovation.late / soft.innovation.noise < 3
