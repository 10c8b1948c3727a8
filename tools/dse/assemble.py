"""Putting a run together from its messages."""

from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dse import events, lcmtypes
from dse.errors import UserError
from dse.events import EventLog, Messages
from dse.run import Done, Estimates, Exchanges, Floats, Ints, Network, Node, Run, Series, Signal
from dse.run_info import PLANT, Sender, collect, signals

ROLES = {
    lcmtypes.header_t.ROLE_PLANT: "the plant",
    lcmtypes.header_t.ROLE_FDI: "dse-fdi",
    lcmtypes.header_t.ROLE_RUN: "dse-run",
}
"""Senders that are no nodes."""


class Assembly:
    """Puts a run together from the messages of its id."""

    def __init__(self, log: EventLog, run_id: int, warnings: list[str]) -> None:
        self.log, self.run_id, self.warnings = log, run_id, warnings
        self.messages = self._messages(run_id)
        self.repeated = 0
        self.infos = self._run_infos()

    def run(self, other_runs: dict[int, int]) -> Run:
        """The whole run; other_runs is passed on."""
        self._add_source()
        plant = self.infos.get(PLANT)
        if plant is None or plant.get("kind") != "plant":
            raise UserError(
                f"{self.log.path}: no run_info of the plant for run {self.run_id:#x}, so names and"
                f" units are unknown: {'; '.join(self.faults) or 'was the logger started late?'}"
            )
        self.warnings += self.faults
        self._check_types(plant)
        about = plant.get("plant") or {}
        states, inputs, outputs = (
            signals(about.get(key)) for key in ("states", "inputs", "outputs")
        )
        unknown = [i for i, one in enumerate(about.get("inputs") or []) if one.get("unknown")]
        truth = self._series("truth_t", "truth", len(states) + len(unknown))
        told = self._series("input_t", "inputs", len(inputs))
        networks = self._networks(plant, len(states))
        return Run(
            log=self.log,
            run_id=self.run_id,
            info=plant,
            states=states,
            inputs=inputs,
            outputs=outputs,
            truth=Series(truth.sample, truth.time, truth.value[:, : len(states)]),
            input=_reveal(told, unknown, truth, len(states)),
            measurements=self._measurements(about.get("groups") or [], outputs),
            networks=networks,
            other_runs=other_runs,
            lost=self._lost(networks),
            repeated=self.repeated,
            ended=self._ended(),
            warnings=self.warnings,
        )

    def _messages(self, run_id: int) -> dict[str, Messages]:
        """The messages of a run by type; types without any are left out."""
        found = {
            name: messages[messages["header"]["run_id"] == run_id]
            for name, messages in self.log.messages.items()
        }
        return {name: messages for name, messages in found.items() if len(messages)}

    def _add_source(self) -> None:
        """In a replay by lcm-logplayer the plant speaks with the id of the recorded run."""
        sources = {int(info.get("source_run") or self.run_id) for info in self.infos.values()}
        for source in sources - {self.run_id} if PLANT not in self.infos else ():
            for name, messages in self._messages(source).items():
                said = messages[messages["header"]["role"] == lcmtypes.header_t.ROLE_PLANT]
                self.messages[name] = np.concatenate([said, self._of(name)])
            self.infos = self._run_infos() | self.infos
            self.warnings.append(f"a replay: plant and truth are those of run {source:#x}")

    def _check_types(self, plant: dict[str, Any]) -> None:
        """Say so when the log was written with other message types than ours."""
        for name, text in (plant.get("type_hashes") or {}).items():
            generated = getattr(lcmtypes, str(name).rpartition(".")[2].removeprefix("dse_"), None)
            with suppress(ValueError):
                if generated is not None and int(text, 16) != generated().get_hash():
                    version = plant.get("dse_version")
                    self.warnings.append(f"dse {version} wrote this log with another {name}")

    def _of(self, type_name: str) -> Messages:
        """The run's messages of a type, in order of the log within a channel."""
        none: Messages = np.empty(0, dtype=events.layout(type_name))
        return self.messages.get(type_name, none)

    def _run_infos(self) -> dict[Sender, dict[str, Any]]:
        infos, self.faults = collect(self._of("run_info_t"))
        return infos

    def _vector(
        self, messages: Messages, who: str, names: tuple[str, ...]
    ) -> tuple[Messages, list[Floats]]:
        """Join the parts of each sample: the messages of part 0 and the vectors `names`, (K, n).

        Repetitions are dropped, samples of which a part is missing too; both are counted.
        """
        messages = messages[messages["header"]["sample"] >= 0]
        sample, part = messages["header"]["sample"].astype(np.int64), messages["part"]
        key = sample * (1 << 16) + part
        _, first = np.unique(key, return_index=True)
        self.repeated += len(messages) - len(first)
        messages, sample, part = messages[first], sample[first], part[first]

        samples, row, have = np.unique(sample, return_inverse=True, return_counts=True)
        is_whole = have == _at(row, len(samples), messages["parts"])
        if lacking := int((~is_whole).sum()):
            self.warnings.append(f"{lacking} samples of {who} are incomplete and left out")
        capacity = messages.dtype[names[0]].shape[0]
        width = int(max((part.astype(int) * capacity + messages["count"]).max(initial=0), 0))
        vectors = []
        for name in names:
            vector = np.full((len(samples), width + capacity), np.nan)
            valid = np.arange(capacity) < messages["count"][:, None]
            values = np.where(valid, messages[name].astype(float), np.nan)
            columns = part.astype(int)[:, None] * capacity + np.arange(capacity)
            vector[row[:, None], np.minimum(columns, width + capacity - 1)] = values
            vectors.append(vector[is_whole, :width])
        return messages[part == 0][is_whole[row[part == 0]]], vectors

    def _series(self, type_name: str, who: str, expected: int) -> Series:
        heads, (value,) = self._vector(self._of(type_name), who, ("value",))
        value = self._fit(value, expected, who)
        return Series(_samples(heads), _times(heads), value)

    def _fit(self, value: Floats, expected: int, who: str) -> Floats:
        """Exactly the columns that run_info names: missing ones become NaN, further ones go."""
        if len(value) and value.shape[1] != expected:
            self.warnings.append(
                f"{who}: {value.shape[1]} values a sample, but run_info names {expected}"
            )
        if value.shape[1] == expected:
            return value
        fitted = np.full((len(value), expected), np.nan)
        common = min(expected, value.shape[1])
        fitted[:, :common] = value[:, :common]
        return fitted

    def _measurements(
        self, groups: list[dict[str, Any]], outputs: list[Signal]
    ) -> dict[str, tuple[list[Signal], Series]]:
        found: dict[str, tuple[list[Signal], Series]] = {}
        messages = self._of("measurement_t")
        for group in np.unique(messages["header"]["node"]).tolist():
            about = groups[group] if group < len(groups) else {}
            name = str(about.get("name") or f"group {group}")
            own = messages[messages["header"]["node"] == group]
            heads, (value, valid) = self._vector(own, f"group {name}", ("value", "valid"))
            value = np.where(valid == 1, value, np.nan)
            indices = [i for i in about.get("outputs") or [] if 0 <= i < len(outputs)]
            signals = [outputs[i] for i in indices]
            if not about:
                signals = [Signal(f"y{group}_{i}") for i in range(value.shape[1])]
            value = self._fit(value, len(signals), f"group {name}")
            found[name] = (signals, Series(_samples(heads), _times(heads), value))
        return found

    def _networks(self, plant: dict[str, Any], n_states: int) -> list[Network]:
        """Every node that run_info names or that is heard of in the log."""
        declared = plant.get("networks") or []
        senders = {sender for sender in self.infos if sender[0] >= 0}
        heard = ("estimate_t", "done_t", "exchange_t")
        for header in (self._of(name)["header"] for name in heard):
            pairs = np.unique(np.stack([header["network"], header["node"]], axis=1), axis=0)
            senders.update((a, b) for a, b in pairs.tolist() if a >= 0)
        for index, about in enumerate(declared):
            senders.update((index, node) for node in range(int(about.get("nodes") or 0)))
        networks: list[Network] = []
        for index in sorted({network for network, _ in senders}):
            about = declared[index] if index < len(declared) else {}
            own = sorted(node for network, node in senders if network == index)
            name = str(about.get("name") or f"network {index}")
            if name in [network.name for network in networks]:
                name = f"{name} ({index})"
            nodes = [self._node(index, node, name, n_states) for node in own]
            method = str(about.get("method") or (nodes[0].method if nodes else ""))
            title = str(about.get("title") or (nodes[0].method_title if nodes else ""))
            networks.append(Network(index, name, title, method, nodes))
        return networks

    def _node(self, network: int, node: int, network_name: str, n_states: int) -> Node:
        info = self.infos.get((network, node))
        who = f"{network_name}/{(info or {}).get('name') or node}"
        heads, (state, variance) = self._vector(
            self._sent("estimate_t", network, node), f"estimates of {who}", ("state", "variance")
        )
        used = int(heads["diagnostics"].max(initial=0))
        if info is None:
            # The estimate tells how many states there are, not which ones, unless it has all.
            if len(heads) and state.shape[1] == n_states:
                self.warnings.append(f"no run_info of {who}: taken to estimate all states in order")
                info = {"states": list(range(n_states))}
            else:
                self.warnings.append(f"no run_info of {who}: its estimates are not used")
                heads, info = heads[:0], {}
                state, variance = state[:0], variance[:0]
        states = [i for i in info.get("states") or [] if 0 <= i < n_states]
        estimates = Estimates(
            sample=_samples(heads),
            time=_times(heads),
            value=self._fit(state, len(states), f"estimates of {who}"),
            variance=self._fit(variance, len(states), f"variances of {who}"),
            health=heads["health"].astype(np.int8),
            diagnostic=heads["diagnostic"][:, :used].astype(float),
        )
        diagnostics = signals(info.get("diagnostics"))[:used]
        diagnostics += [Signal(f"diagnostic {i}") for i in range(len(diagnostics), used)]
        status, estimate_hash = self._status(network, node, who)
        storage = info.get("storage_bytes")
        return Node(
            network=network,
            node=node,
            name=str(info.get("name") or f"node {node}"),
            method=str(info.get("method") or ""),
            method_title=str(info.get("method_title") or ""),
            states=states,
            diagnostics=diagnostics,
            storage_bytes=int(storage) if storage is not None else None,
            neighbours=list(info.get("neighbours") or []),
            groups=list(info.get("groups") or []),
            every=max(int(info.get("every") or 1), 1),
            frames=[(one[0], one[1]) for one in info.get("frames") or [] if len(one) == 2],
            estimates=estimates,
            done=self._done(network, node),
            exchanges=self._exchanges(network, node),
            status=status,
            estimate_hash=estimate_hash,
        )

    def _sent(self, type_name: str, network: int, node: int) -> Messages:
        messages = self._of(type_name)
        header = messages["header"]
        sent: Messages = messages[(header["network"] == network) & (header["node"] == node)]
        return sent

    def _done(self, network: int, node: int) -> Done:
        messages = self._sent("done_t", network, node)
        messages = messages[messages["header"]["sample"] >= 0]
        sample, first = np.unique(_samples(messages), return_index=True)
        self.repeated += len(messages) - len(first)
        messages = messages[first]
        return Done(
            sample=sample,
            rounds=messages["rounds"].astype(np.int64),
            sent=messages["sent"].astype(np.int64),
            sent_bytes=messages["sent_bytes"].astype(np.int64),
            step_s=messages["step_s"].astype(float),
        )

    def _exchanges(self, network: int, node: int) -> Exchanges:
        messages = self._sent("exchange_t", network, node)
        header = messages["header"]
        key = (_samples(messages) << 32) + (header["round"].astype(np.int64) << 16)
        _, first = np.unique(key + messages["part"], return_index=True)
        once = messages[first]
        told = once["withheld"] == 0
        return Exchanges(
            told=int(told.sum()),
            payload_bytes=8 * int(once["count"][told].astype(np.int64).sum()),
            withheld=int((~told).sum()),
            repeats=len(messages) - len(once),
            wire_bytes=len(messages) * (8 + messages.dtype.itemsize),
        )

    def _status(self, network: int, node: int, who: str) -> tuple[dict[str, int], int | None]:
        """Counters and hash of the last status message: all int64 members but identities."""
        messages = self._sent("status_t", network, node)
        if not len(messages):
            return {}, None
        last = messages[np.argmax(messages["header"]["sequence"])]
        if length := int(last["reason_length"].clip(0, len(last["reason"]))):
            reason = last["reason"][:length].tobytes().decode("utf-8", "replace")
            self.warnings.append(f"{who} ended early: {reason}")
        names = [
            name
            for name in messages.dtype.names or ()
            if messages.dtype[name].kind == "i"
            and messages.dtype[name].itemsize == 8
            and name not in ("instance", "scenario_hash", "estimate_hash")
        ]
        own_hash = int(last["estimate_hash"]) & (1 << 64) - 1
        return {name: int(last[name]) for name in names}, own_hash or None

    def _lost(self, networks: list[Network]) -> dict[str, int]:
        """Gaps in the sequence numbers of every (sender, type).

        What was sent before the logger started is no gap; it shows in the first sample.
        """
        known = {(n.index, m.node): f"{n.name}/{m.name}" for n in networks for m in n.nodes}
        lost = {}
        for name, messages in self.messages.items():
            for (role, network, node), numbers in _numbers(messages).items():
                missing = int(numbers[-1] - numbers[0]) + 1 - len(numbers)
                if missing:
                    sender = known.get((network, node), ROLES.get(role, f"role {role}"))
                    lost[f"{name} of {sender}"] = missing
        if lost:
            listed = [f"{count} {what}" for what, count in lost.items()]
            further = f" and {len(listed) - 3} more kinds" if len(listed) > 3 else ""
            self.warnings.append(
                f"{sum(lost.values())} messages are missing in the log (gaps in the sequence"
                f" numbers): {', '.join(listed[:3])}{further}"
            )
        return lost

    def _ended(self) -> str:
        clocks = self._of("clock_t")
        stops = clocks[clocks["event"] == lcmtypes.clock_t.EVENT_STOP]
        if not len(stops):
            return "not in the log"
        last = stops[-1]
        return "complete" if last["complete"] else f"early, at sample {last['header']['sample']}"


def _numbers(messages: Messages) -> dict[tuple[int, int, int], Ints]:
    """Sequence numbers, ascending, by sender: (role, network, node).

    The plant is one sender, also where the node in its header is a sensor group.
    """
    header = messages["header"]
    node = np.where(header["role"] == lcmtypes.header_t.ROLE_PLANT, 0, header["node"])
    who = np.stack([header["role"], header["network"], node], axis=1)
    senders, index = np.unique(who, axis=0, return_inverse=True)
    return {
        (role, network, number): np.unique(
            header["sequence"][index.reshape(-1) == i].astype(np.int64)
        )
        for i, (role, network, number) in enumerate(senders.tolist())
    }


def _reveal(told: Series, unknown: list[int], truth: Series, n_states: int) -> Series:
    """Inputs as they were: the truth has, behind its states, those that estimators were not told.

    NaN where the log has no truth.
    """
    value = told.value.copy()
    value[:, unknown] = np.nan
    _, mine, true = np.intersect1d(told.sample, truth.sample, return_indices=True)
    for column, i in enumerate(unknown):
        value[mine, i] = truth.value[true, n_states + column]
    return Series(told.sample, told.time, value)


def _samples(messages: Messages) -> Ints:
    samples: Ints = messages["header"]["sample"].astype(np.int64)
    return samples


def _times(messages: Messages) -> Floats:
    times: Floats = messages["header"]["plant_time"].astype(float)
    return times


def _at(row: NDArray[np.intp], size: int, value: NDArray[Any]) -> Ints:
    """The value scattered to rows: one of several that fall on the same row."""
    scattered = np.zeros(size, dtype=np.int64)
    scattered[row] = value
    return scattered
