"""What the scenarios AHO-E1 to AHO-E6 claim, on logs of their runs (sim/scenarios/README.md).

R1 to R13 are the statements of the adaptive distributed observers' notes; those about Lyapunov
functions (R4, R9) are tests of the library. IE and ID are the integrals of the node-average error
and of the disagreement. Many seeds are for `ctest -L long`.
"""

import json
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from harness import BIN, tool
from reference_dkf import Continuous, Discrete, Setting, measurements

from dse.agreement import Agreement, agreement, same_states
from dse.design.sweep import settings
from dse.log import read
from dse.metrics import l2_norm
from dse.run import Floats, Run

Recorded = Callable[..., Run]
ORDER = ("edge", "node", "standard", "none")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """A run of a scenario with a seed and changes; made once, the log is not kept."""
    log = tmp_path_factory.mktemp("logs") / "run.lcm"
    known: dict[tuple[object, ...], Run] = {}

    def run(scenario: str, seed: int | None = None, *changes: str) -> Run:
        key = (scenario, seed, *changes)
        if key not in known:
            words = [str(BIN / "dse-run"), scenario, "--inproc", "--quiet", "--log", str(log)]
            words += [*(("--seed", str(seed)) if seed else ()), *changes]
            said = subprocess.run(words, capture_output=True, text=True, timeout=500)
            assert said.returncode == 0, said.stderr
            known[key] = read(log)
            log.unlink()
        return known[key]

    return run


def together(run: Run, name: str) -> Agreement:
    """The measures of a network whose nodes estimate the same states."""
    found = agreement(run, run.network(name), 0.5)
    assert found is not None
    return found


def of_seeds(
    recorded: Recorded, scenario: str, seeds: Sequence[int], names: Sequence[str], *changes: str
) -> dict[str, Floats]:
    """By network: rows of IE, ID and the mean error of the second half, a column per seed."""
    found: dict[str, list[tuple[float, float, float]]] = {name: [] for name in names}
    for seed in seeds:
        run = recorded(scenario, seed, *changes)
        for name in names:
            m = together(run, name)
            found[name].append((m.error_integral, m.disagreement_integral, m.late_error))
    return {name: np.array(rows).T for name, rows in found.items()}


def node_l2(run: Run, name: str) -> list[float]:
    """L2 norm of each node's error."""
    found = same_states(run, run.network(name))
    assert found is not None
    time, _, error = found
    return [l2_norm(time, error[i : i + 1]) for i in range(len(error))]


# ---- the agents do what the equations say ----


def setting_of(run: Run, name: str) -> Setting:
    """A network's section as the reference takes it."""
    (network,) = [one for one in settings(run)["networks"] if one["name"] == name]
    section, graph = network["distributed_kalman"], network["graph"]
    pairs = list(zip(graph["edges"][::2], graph["edges"][1::2], strict=True))
    if graph.get("undirected"):
        pairs += [(j, i) for i, j in pairs]
    C = np.array(settings(run)["plant"]["linear"]["C"], dtype=float).reshape(-1, 2)
    return Setting(
        scheme=section["scheme"],
        hears=[sorted(j for j, to in pairs if to == i) for i in range(graph["nodes"])],
        C=C,
        R=np.array(section["R"], dtype=float),
        x0=np.array(section["guesses"], dtype=float).reshape(-1, 2),
        gamma=section["gamma"],
        sigma=section.get("sigma", 0.0),
    )


def estimates(run: Run, name: str) -> Floats:
    """(K, N, 2)."""
    found = same_states(run, run.network(name))
    assert found is not None
    return np.swapaxes(found[1], 0, 1)


@pytest.mark.parametrize("name", ["edge", "node", "global", "standard", "none"])
def test_continuous_filters_estimate_what_the_published_laws_do(
    recorded: Recorded, name: str
) -> None:
    """The first 60 samples by an implementation of its own, on the logged measurements."""
    run = recorded("aho-e2")
    y, logged = measurements(run), estimates(run, name)
    again = Continuous(setting_of(run, name))
    for k in range(60):
        np.testing.assert_allclose(again.x, logged[k], rtol=1e-9, atol=1e-9)
        again.step(k, y[k])
    assert np.abs(logged[59] - logged[0]).max() > 1


@pytest.mark.parametrize("name", ["edge", "edge_filtered"])
def test_discrete_filters_estimate_what_the_published_laws_do(
    recorded: Recorded, name: str
) -> None:
    run = recorded("aho-dt_ring6")
    y, logged = measurements(run), estimates(run, name)
    again = Discrete(setting_of(run, name), name.removeprefix("edge_"), 0.02)
    for k in range(150):
        again.sample(k, y[k])
        np.testing.assert_allclose(again.x, logged[k], rtol=1e-9, atol=1e-9)


def test_whole_states_or_projections_give_the_same_estimates(recorded: Recorded) -> None:
    """R5: (2.17) is (2.11) but for rounding."""
    run = recorded("aho-e2")
    np.testing.assert_allclose(estimates(run, "full"), estimates(run, "node"), rtol=1e-9, atol=1e-9)


# ---- communication ----


def test_aho_e1_an_exchange_costs_5038_or_6870_bytes(recorded: Recorded) -> None:
    run = recorded("aho-e1", None, "--set", "time.duration_s=0.05")
    frames = {
        network.name: [values for node in network.nodes for _, values in node.frames]
        for network in run.networks
    }
    bytes_ = {name: sum(7 + 4 * v for v in values) for name, values in frames.items()}
    assert {name: len(values) for name, values in frames.items()} == {
        "edge": 458, "node": 458, "standard": 458, "none": 0,
    }  # fmt: skip
    assert bytes_ == {"edge": 5038, "node": 5038, "standard": 6870, "none": 0}


def test_aho_e1_the_report_shows_the_model_beside_the_log(
    tmp_path: Path,
) -> None:
    log = tmp_path / "run.lcm"
    words = [str(BIN / "dse-run"), "aho-e1", "--inproc", "--quiet", "--log", str(log)]
    subprocess.run([*words, "--set", "time.duration_s=0.05"], check=True, timeout=100)
    said = subprocess.run(
        [tool("dse"), "report", str(log), "--json"], capture_output=True, text=True, check=True
    )
    found = {n: m["communication"] for n, m in json.loads(said.stdout)["networks"].items()}
    assert found["edge"]["frame_bytes"] == 5038
    assert found["standard"]["frame_bytes"] == 6870
    # On a bus each node says at most two numbers, one for each kind of sensor that listens.
    assert found["edge"]["messages"] == found["standard"]["messages"] == 50
    assert found["edge"]["payload_bytes"] <= found["standard"]["payload_bytes"] == 50 * 2 * 8


# ---- R1 to R3: simulations 1 to 4 ----


def test_aho_e2_ordering_on_the_mean_of_seeds(recorded: Recorded) -> None:
    found = of_seeds(recorded, "aho-e2", (1, 2), ORDER)
    means = np.array([found[name].mean(axis=1) for name in ORDER])
    assert (np.diff(means[:, :2], axis=0) > 0).all(), means
    assert means[0, 2] < 0.7 * means[3, 2]


@pytest.mark.long
@pytest.mark.parametrize(
    ("scenario", "seeds", "published"),
    [
        ("aho-e1", 4, {"edge": (5.46, 176), "node": (6.63, 201), "standard": (8.41, 218),
                       "none": (8.85, 245)}),
        ("aho-e2", 8, {"edge": (12.7, 53.4), "node": (15.1, 69.3), "standard": (20.0, 86.5),
                       "none": (25.0, 113)}),
        ("aho-e3", 16, {"edge": (12.4, 49.9), "node": (14.1, 61.4), "standard": (20.9, 92.7),
                        "none": (25.0, 113)}),
        ("aho-e4", 8, {"edge": (14.3, 43.1), "node": (15.0, 47.1), "none": (16.8, 46.1)}),
    ],
)  # fmt: skip
def test_means_of_all_seeds_are_those_of_an_independent_implementation(
    recorded: Recorded, scenario: str, seeds: int, published: dict[str, tuple[float, float]]
) -> None:
    """Other noise: means of so many seeds agree within 10 %, and so does the ordering (R1, R2)."""
    names = list(published)
    found = of_seeds(recorded, scenario, range(1, seeds + 1), names)
    for name, (IE, ID) in published.items():
        assert found[name][:2].mean(axis=1) == pytest.approx([IE, ID], rel=0.1), name
    errors = np.array([found[name][0] for name in names])
    assert (np.diff(errors.mean(axis=1)) > 0).all()
    # Every scheme beats filters alone with every seed, but for one in aho-e4.
    worse = (errors[:-1] >= errors[-1]).sum()
    assert worse == (1 if scenario == "aho-e4" else 0)


@pytest.mark.long
@pytest.mark.parametrize(("scenario", "seeds"), [("aho-e1", 4), ("aho-e2", 8)])
def test_the_error_of_a_gain_per_edge_after_5_s(
    recorded: Recorded, scenario: str, seeds: int
) -> None:
    """R3: at most 0.7 of that without coupling, on the mean of the seeds."""
    found = of_seeds(recorded, scenario, range(1, seeds + 1), ORDER)
    assert found["edge"][2].mean() < 0.7 * found["none"][2].mean()


@pytest.mark.long
def test_aho_e4_after_5_s_coupling_is_worth_nothing(recorded: Recorded) -> None:
    """What it gains, it gains at the start."""
    found = of_seeds(recorded, "aho-e4", range(1, 9), ("edge", "node", "none"))
    for name in ("edge", "node"):
        assert 0.9 < found[name][2].mean() / found["none"][2].mean() < 1.05


@pytest.mark.long
def test_aho_e2_a_standard_filter_with_a_larger_weight_does_as_well(recorded: Recorded) -> None:
    """What the ordering is worth: it holds at equal gamma only."""
    seeds = range(1, 9)
    adaptive = of_seeds(recorded, "aho-e2", seeds, ("edge",))["edge"][0].mean()
    tuned = [
        of_seeds(
            recorded, "aho-e2", seeds, ("standard",),
            "--set", f"networks.standard.distributed_kalman.gamma={gamma}",
        )["standard"][0].mean()
        for gamma in (0.02, 0.1, 0.5)
    ]  # fmt: skip
    assert tuned[0] > 1.3 * adaptive
    assert tuned[1] < 1.1 * adaptive
    assert tuned[2] < 0.8 * adaptive


# ---- protections ----


def test_aho_loss_a_held_neighbour_is_worth_more_than_none(recorded: Recorded) -> None:
    names = ("perfect", "dropped", "held", "node_held", "none")
    found = of_seeds(recorded, "aho-loss_ring6", (1, 2), names)
    IE = {name: values[0].mean() for name, values in found.items()}
    assert IE["held"] < 1.1 * IE["perfect"]
    assert IE["held"] < 0.8 * IE["dropped"]
    assert IE["dropped"] < 0.9 * IE["none"]
    assert IE["node_held"] < 0.7 * IE["none"]


def test_aho_loss_a_neighbour_that_is_gone_is_left_out(recorded: Recorded) -> None:
    """Sensor 4 is heard by 3 and 5 until 6 s; hold is 3 samples; losses in a row are rare then."""
    run = recorded("aho-loss_ring6")
    for node in (run.network("held").nodes[i] for i in (3, 5)):
        names = [signal.name for signal in node.diagnostics]
        used = node.estimates.diagnostic[:, names.index("neighbours used")]
        assert (used[50:600] == 2).mean() > 0.9
        assert (used[605:] <= 1).all()
        assert (used[605:] == 1).mean() > 0.9
        gain = node.estimates.diagnostic[:, names.index("largest Gamma")]
        assert np.isfinite(gain).all()


def test_aho_kf_variants_all_beat_filters_alone(recorded: Recorded) -> None:
    names = ("covariance", "gain", "lyapunov", "luenberger", "leak", "limit", "none")
    found = of_seeds(recorded, "aho-kf_variants", (1,), names)
    IE = {name: values[0].mean() for name, values in found.items()}
    assert all(IE[name] < 0.85 * IE["none"] for name in names[:-1]), IE
    limited = recorded("aho-kf_variants", 1).network("limit")
    gains = np.array([node.estimates.diagnostic[:, 0] for node in limited.nodes])
    assert gains.max() == pytest.approx(10)


def test_aho_lti_gains_of_the_desk_do_as_well(recorded: Recorded) -> None:
    """In the filter, and in an observer that is another piece of code and interpolates."""
    run = recorded("aho-lti")
    found = {network.name: together(run, network.name) for network in run.networks}
    assert found["given"].error_integral == pytest.approx(found["riccati"].error_integral, rel=0.02)
    assert found["observer"].l2_norm == pytest.approx(found["given"].l2_norm, rel=0.02)
    assert found["given"].error_integral < 0.97 * found["alone"].error_integral
    final = estimates(run, "observer")[-1] - estimates(run, "given")[-1]
    assert np.abs(final).max() < 0.2


# ---- R6 to R10: unknown-input observers ----


def test_aho_e5_norms_are_those_of_an_independent_implementation(recorded: Recorded) -> None:
    """R6, R7, R9, R10. Agents hold their neighbours' words for a period: 54.90, not 54.915."""
    run = recorded("aho-e5")
    found = {network.name: together(run, network.name).l2_norm for network in run.networks}
    assert found["none"] == pytest.approx(97.587, rel=1e-4)
    assert found["printed"] == pytest.approx(54.90, rel=1e-4)
    assert found["consistent"] == pytest.approx(44.13, rel=1e-4)
    for name, norm in (
        *(("printed_node", 52.15), ("projected", 84.02), ("leak", 83.90)),
        *(("consistent_ring", 40.02), ("printed_ring", 91.53)),
    ):
        assert found[name] == pytest.approx(norm, rel=3e-3), name


def test_aho_e5_no_node_is_worse_with_coupling(recorded: Recorded) -> None:
    """R7; node 1 hears nobody. On the ring node 1 gets worse with the printed law."""
    run = recorded("aho-e5")
    alone = np.array(node_l2(run, "none"))
    for name in ("printed", "consistent", "consistent_ring"):
        assert (np.array(node_l2(run, name)) <= alone * (1 + 1e-9)).all(), name
    assert node_l2(run, "printed")[1] == pytest.approx(alone[1], rel=1e-12)
    assert node_l2(run, "printed_ring")[1] > 2 * alone[1]


@pytest.mark.long
def test_aho_e5_smaller_periods_lead_to_the_continuous_network(recorded: Recorded) -> None:
    run = recorded(
        "aho-e5", None, "--set", "time.period_s=0.0025", "--set", "time.duration_s=5.0025"
    )
    assert together(run, "printed").l2_norm == pytest.approx(54.915, rel=1e-4)
    assert together(run, "consistent").l2_norm == pytest.approx(44.174, rel=5e-4)


def strongly_connected(generator: np.random.Generator, edges: int) -> list[int]:
    """A random digraph of six nodes: from, to, from, to, .."""
    pairs = [(i, j) for i in range(6) for j in range(6) if i != j]
    while True:
        chosen = [pairs[k] for k in generator.choice(len(pairs), edges, replace=False)]
        reach = np.eye(6, dtype=bool)
        for i, j in chosen:
            reach[i, j] = True
        if (np.linalg.matrix_power(reach.astype(float), 6) > 0).all():
            return [int(node) for pair in chosen for node in pair]


@pytest.mark.long
def test_aho_e5_the_printed_law_does_not_always_help(recorded: Recorded) -> None:
    """R8: of random strongly connected graphs 87 % are better than alone; the median is 93."""
    generator = np.random.default_rng(8)
    norms = []
    for _ in range(60):
        edges = strongly_connected(generator, int(generator.integers(6, 11)))
        graph = f"networks.printed.graph={{nodes: 6, edges: {edges}}}"
        norms.append(together(recorded("aho-e5", None, "--set", graph), "printed").l2_norm)
    better = np.mean(np.array(norms) < 97.59)
    assert 0.75 < better < 0.97
    assert np.median(norms) == pytest.approx(93, abs=2)
    assert 75 < min(norms) < 90
    assert 97.59 < max(norms) < 110


# ---- R11 to R13: functional observers ----


def test_aho_e6_norms_are_near_those_of_the_continuous_network(recorded: Recorded) -> None:
    run = recorded("aho-e6")
    found = {network.name: together(run, network.name).l2_norm for network in run.networks}
    assert found["none"] == pytest.approx(65.574, rel=1e-4)
    for name, norm in (
        *(("printed", 31.723), ("consistent", 14.215), ("leak", 31.759), ("slow", 35.928)),
        *(("both_ways", 30.179), ("both_ways_node", 29.487)),
    ):
        assert found[name] == pytest.approx(norm, rel=0.011), name
    assert found["printed"] < 0.55 * found["none"]
    alone = np.array(node_l2(run, "none"))
    assert (np.array(node_l2(run, "printed")) < alone).all()
    assert (np.array(node_l2(run, "consistent")) < alone).all()


def test_aho_e6_what_is_held_for_a_period_leaves_an_error_of_its_order(
    recorded: Recorded,
) -> None:
    """Agents follow their neighbours' words of a period ago: about 5 h at the end, not 1e-9."""
    final = []
    for h in (0.01, 0.02):
        changes = ("--set", f"time.period_s={h}", "--set", f"time.duration_s={10 + h}")
        run = recorded("aho-e6", None, *changes)
        found = same_states(run, run.network("consistent"))
        assert found is not None
        final.append(np.abs(found[2][:, -1]).max())
    assert 1e-3 < final[0] < 6 * 0.01
    assert final[1] == pytest.approx(2 * final[0], rel=0.15)


# ---- the shipped matrices ----


@pytest.mark.parametrize(
    ("scenario", "name", "command"),
    [
        ("aho-e5", "consistent", ("uio", "descriptor_uio", "--law", "projected")),
        ("aho-e6", "printed", ("functional", "descriptor_fo", "--law", "printed")),
        ("aho-e6", "consistent", ("functional", "descriptor_fo")),
    ],
)
def test_the_matrices_are_those_that_dse_design_writes(
    recorded: Recorded, tmp_path: Path, scenario: str, name: str, command: tuple[str, ...]
) -> None:
    import yaml

    file = tmp_path / "design.yaml"
    subprocess.run([tool("dse"), "design", *command, "-o", str(file)], check=True, timeout=100)
    fresh = yaml.safe_load(file.read_text())["distributed_observer"]["nodes"]
    tree = settings(recorded(scenario))["networks"]
    (network,) = [one for one in tree if one["name"] == name]
    shipped = network["distributed_observer"]["nodes"]
    assert len(fresh) == len(shipped)
    for mine, theirs in zip(shipped, fresh, strict=True):
        assert {key for key in theirs if key not in ("D", "D_y", "D_u")} <= mine.keys()
        for key, value in theirs.items():
            np.testing.assert_allclose(mine[key], value, rtol=1e-9, atol=1e-9)
