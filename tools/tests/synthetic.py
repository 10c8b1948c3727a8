"""Writes logs as dse's agents would, with faults on demand."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import lcm
import numpy as np

from dse import lcmtypes

STATES = (
    ("T1", "K", "temperature of reactor 1", 10.0),
    ("C1", "kmol/m3", "concentration in reactor 1", 1.0),
    ("T2", "K", "temperature of reactor 2", 10.0),
    ("C2", "kmol/m3", "concentration in reactor 2", 1.0),
)
NETWORKS = (("ahg", "high_gain_ekf", 60.0), ("ekf", "ekf", 6.0))
"""Name, method and how fast the initial error decays, per hour."""
PERIOD = 1 / 3600


@dataclass
class Plan:
    """What to write, and what shall be wrong with it."""

    samples: int = 200
    run_id: int = 0x1234567890ABCDEF >> 4
    seed: int = 1
    noise: float = 0.05
    bias: float = 0.0
    """Added to every estimate of T1 from sample 50 on."""
    run_info: bool = True
    node_info: bool = True
    truth: bool = True
    skip: set[tuple[int, int, int]] = field(default_factory=set)
    """(network, node, sample) without an estimate."""
    lose: set[tuple[int, int, int]] = field(default_factory=set)
    """(network, node, sample) whose estimate was sent but is not in the log."""
    repeat: set[tuple[int, int, int]] = field(default_factory=set)
    """(network, node, sample) whose estimate is in the log twice."""
    coasting: range = range(60, 80)
    """Samples at which the second network has no data of its own."""
    states: int = 4
    """More than 4: further states x4, x5, .. that node 0 of each network estimates."""
    disturbed: bool = False
    """A second input that estimators are not told: sample number over ten."""


class Writer:
    """Messages with headers and sequence numbers as the agents give them."""

    def __init__(self, log: lcm.EventLog, plan: Plan) -> None:
        self.log, self.plan, self.us = log, plan, 1_700_000_000_000_000
        self.sequence: dict[tuple[str, int, int, int], int] = {}

    def header(
        self, kind: str, role: int, network: int, node: int, k: int, round_: int = 0
    ) -> lcmtypes.header_t:
        """The header of a new message."""
        # The plant numbers its measurements through, whatever the group.
        sender = (kind, role, network, node if role else 0)
        number = self.sequence.get(sender, 0)
        self.sequence[sender] = number + 1
        header = lcmtypes.header_t()
        header.run_id, header.sample, header.plant_time = self.plan.run_id, k, max(k, 0) * PERIOD
        header.sequence, header.round, header.network = number, round_, network
        header.role, header.node = role, node
        return header

    def put(self, channel: str, message: Any) -> None:  # noqa: ANN401 - any generated type
        """Write a message."""
        self.us += 50
        self.log.write_event(self.us, channel, message.encode())


def state_names(plan: Plan) -> list[tuple[str, str, str, float]]:
    further = [(f"x{i}", "", f"state {i}", 1.0) for i in range(4, plan.states)]
    return [*STATES, *further]


def node_states(plan: Plan, node: int) -> list[int]:
    return ([0, 1, *range(4, plan.states)], [2, 3])[node]


def truth(plan: Plan) -> np.ndarray:
    """(K, n)."""
    t = np.arange(plan.samples) * PERIOD
    columns = [388 + 6 * np.exp(-30 * t), 3 - np.exp(-20 * t), 386 + 4 * np.sin(60 * t), 2.8 + t]
    columns += [np.cos((i + 1) * 20 * t) for i in range(4, plan.states)]
    return np.stack(columns, axis=1)


def estimate(plan: Plan, network: int) -> np.ndarray:
    """(K, n): an initial error of 10 K and -2 kmol/m3 that decays, and noise."""
    generator = np.random.default_rng([plan.seed, network])
    x = truth(plan)
    t = np.arange(plan.samples)[:, None] * PERIOD
    start = np.array([10.0, -2.0] * 2 + [0.5] * (plan.states - 4))
    error = start * np.exp(-NETWORKS[network][2] * t)
    error += plan.noise * generator.standard_normal(x.shape) * (t > 0)
    error[50:, 0] += plan.bias
    return x + error


def variance(plan: Plan, network: int) -> float:
    """The first network has one, the second has none."""
    return plan.noise**2 if network == 0 else float("nan")


def published_hash(plan: Plan, network: int, node: int) -> int:
    """FNV-1a over states and variances, sample after sample, as the agents compute it."""
    digest = 0xCBF29CE484222325
    for state in estimate(plan, network)[:, node_states(plan, node)]:
        for byte in np.append(state, [variance(plan, network)] * len(state)).tobytes():
            digest = ((digest ^ byte) * 0x100000001B3) % 2**64
    return digest


def parts(values: np.ndarray, capacity: int = 32) -> Iterator[tuple[int, int, int, list[float]]]:
    """(part, parts, count, padded values)."""
    number = max(1, -(-len(values) // capacity))
    for part in range(number):
        piece = list(values[part * capacity : (part + 1) * capacity])
        yield part, number, len(piece), piece + [0.0] * (capacity - len(piece))


def put_info(writer: Writer, role: int, network: int, node: int, info: dict[str, Any]) -> None:
    text = json.dumps(info).encode()
    number = -(-len(text) // 1024)
    for part in range(number):
        message = lcmtypes.run_info_t()
        message.header = writer.header("run_info", role, network, node, -1)
        piece = text[1024 * part : 1024 * (part + 1)]
        message.part, message.parts, message.count = part, number, len(piece)
        message.text = piece.ljust(1024, b"\0")
        writer.put("DSE_RUN_INFO", message)


def plant_info(plan: Plan) -> dict[str, Any]:
    signals = [
        {"name": name, "unit": unit, "title": title, "scale": scale}
        for name, unit, title, scale in state_names(plan)
    ]
    return {
        "kind": "plant",
        "dse_version": "0.1.0",
        "run_id": plan.run_id,
        "seed": plan.seed,
        "pace": "lockstep",
        "scenario": {
            "name": "synthetic",
            "title": "Two reactors, made up",
            "source": "tests",
            "file": "synthetic.yaml",
            "hash": "0123",
            "yaml": "name: synthetic\n" + "# long text\n" * 200,
            "overrides": [f"seed={plan.seed}"],
        },
        "time": {"unit": "h", "unit_s": 3600, "period": PERIOD, "samples": plan.samples},
        "plant": {
            "name": "cstr2",
            "title": "two reactors",
            "set": "ch2",
            "states": signals,
            "inputs": [
                {"name": "Q1", "unit": "kJ/h", "title": "heat", "scale": 1e5},
                *[{"name": "v", "unit": "", "title": "v", "scale": 1.0, "unknown": True}]
                * plan.disturbed,
            ],
            "outputs": [signals[0], signals[2]],
            "parameters": [],
            "groups": [
                {"name": "reactor 1", "outputs": [0]},
                {"name": "reactor 2", "outputs": [1]},
            ],
        },
        "networks": [{"name": n, "method": m, "nodes": 2} for n, m, _ in NETWORKS],
        "type_hashes": {},
    }


def node_info(plan: Plan, network: int, node: int) -> dict[str, Any]:
    name, method, _ = NETWORKS[network]
    diagnostics = [{"name": "innovation", "unit": "K"}]
    if method == "high_gain_ekf":
        diagnostics = [{"name": "theta", "unit": ""}, {"name": "J", "unit": ""}, *diagnostics]
    return {
        "kind": "node",
        "network": network,
        "network_name": name,
        "node": node,
        "name": f"reactor {node + 1}",
        "method": method,
        "method_title": method.replace("_", "-"),
        "states": node_states(plan, node),
        "groups": [node],
        "neighbours": [1 - node],
        "diagnostics": diagnostics,
        "storage_bytes": 4096,
    }


def put_node(
    writer: Writer, network: int, node: int, k: int, x: np.ndarray, innovation: float
) -> None:
    """Exchange, estimate and done of a node at sample k; x: its states."""
    plan, role = writer.plan, lcmtypes.header_t.ROLE_ESTIMATOR
    exchange = lcmtypes.exchange_t()
    exchange.header = writer.header("exchange", role, network, node, k)
    exchange.parts, exchange.count = 1, 2
    exchange.value = [*x[:2], *[0.0] * 30]
    writer.put(f"DSE_EXCHANGE_{network}_{node}", exchange)
    if (k, network, node) == (10, 0, 1):
        exchange.intent = lcmtypes.exchange_t.INTENT_ASK
        writer.put(f"DSE_EXCHANGE_{network}_{node}", exchange)

    if (network, node, k) not in plan.skip:
        put_estimate(writer, network, node, k, x, innovation)

    done = lcmtypes.done_t()
    done.header = writer.header("done", role, network, node, k)
    done.rounds, done.sent, done.sent_bytes = 1, 1, 16
    done.step_s = 1e-5 * (1 + k % 7)
    writer.put("DSE_DONE", done)


def put_estimate(
    writer: Writer, network: int, node: int, k: int, x: np.ndarray, innovation: float
) -> None:
    plan, role = writer.plan, lcmtypes.header_t.ROLE_ESTIMATOR
    diagnostic = [1 + 39 * np.exp(-k / 20), 47 * np.exp(-k / 15)] if network == 0 else []
    diagnostic.append(innovation)
    for part, number, count, values in parts(x):
        message = lcmtypes.estimate_t()
        message.header = writer.header("estimate", role, network, node, k)
        message.health = 0 if k == 0 else 2 if network == 1 and k in plan.coasting else 1
        message.part, message.parts, message.count = part, number, count
        message.diagnostics = len(diagnostic)
        message.state = values
        message.variance = [variance(plan, network)] * 32
        message.diagnostic = diagnostic + [0.0] * (16 - len(diagnostic))
        channel = f"DSE_ESTIMATE_{network}_{node}"
        if (network, node, k) not in plan.lose:
            writer.put(channel, message)
        if (network, node, k) in plan.repeat:
            writer.put(channel, message)


def put_run(log: lcm.EventLog, plan: Plan) -> None:
    """A whole run."""
    writer, plant = Writer(log, plan), lcmtypes.header_t.ROLE_PLANT
    if plan.run_info:
        put_info(writer, plant, -1, 0, plant_info(plan))
    for network, node in ((i, j) for i in range(2) for j in range(2) if plan.node_info):
        put_info(writer, 1, network, node, node_info(plan, network, node))
    x, estimates = truth(plan), [estimate(plan, network) for network in range(2)]
    for k in range(plan.samples):
        put_plant(writer, k, x[k])
        for network in range(2):
            for node in range(2):
                own = estimates[network][k, node_states(plan, node)]
                put_node(writer, network, node, k, own, own[0] - x[k, 2 * node])
    for network, node in ((i, j) for i in range(2) for j in range(2)):
        status = lcmtypes.status_t()
        status.header = writer.header("status", 1, network, node, plan.samples - 1)
        status.instance, status.state = 99, lcmtypes.status_t.STATE_FINISHED
        status.duplicates, status.asked = 3, 1
        status.reason = bytes(200)
        published = published_hash(plan, network, node)
        status.estimate_hash = published - 2**64 if published >= 2**63 else published
        writer.put("DSE_STATUS", status)
    clock = lcmtypes.clock_t()
    clock.header = writer.header("clock", plant, -1, 0, plan.samples - 1)
    clock.event, clock.complete = lcmtypes.clock_t.EVENT_STOP, 1
    writer.put("DSE_CLOCK", clock)


def put_plant(writer: Writer, k: int, x: np.ndarray) -> None:
    plant = lcmtypes.header_t.ROLE_PLANT
    tick = lcmtypes.input_t()
    tick.header = writer.header("input", plant, -1, 0, k)
    tick.parts, tick.count, tick.value = 1, 1 + writer.plan.disturbed, [2.5e5, *[0.0] * 31]
    writer.put("DSE_INPUT", tick)
    for group in range(2):
        message = lcmtypes.measurement_t()
        message.header = writer.header("measurement", plant, -1, group, k)
        message.measured_at, message.parts, message.count = k, 1, 1
        # The channel of group 1 is missing in every tenth sample.
        message.valid = [int(group == 0 or k % 10 != 5), *[0] * 31]
        message.value = [x[2 * group], *[0.0] * 31]
        writer.put(f"DSE_MEASUREMENT_{group}", message)
    if writer.plan.truth:
        hidden = [k / 10] * writer.plan.disturbed
        for part, number, count, values in parts(np.append(x, hidden)):
            message = lcmtypes.truth_t()
            message.header = writer.header("truth", plant, -1, 0, k)
            message.part, message.parts, message.count = part, number, count
            message.value = values
            writer.put("DSE_TRUTH", message)


def write(path: Path, *plans: Plan) -> Path:
    """A log with one run per plan."""
    log = lcm.EventLog(path, "w", overwrite=True)
    for plan in plans or (Plan(),):
        put_run(log, plan)
    log.close()
    return path
