"""Numbers for tuning a high-gain filter, by the steps of the source's flowchart (Fig 2.2).

Section 4.7 of the specification; K samples, n states.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dse.design.sweep import settings
from dse.evaluate import evaluate, pooled_errors
from dse.metrics import NAN, error_norm, late
from dse.run import Floats, Network, Node, Run

SECTION = "high_gain_ekf"
SEEN = 30
"""Noise sensitivity is judged beside a moving mean over this part of the run, K/30 samples."""

SETTLED = 0.1
"""Part of the first error norm below which the truth counts as reached."""

STEPS = {
    1: "1. theta = 1: does a plain EKF reject the noise at rest? (Q, R)",
    2: "2. theta = 2 theta_m throughout: fast enough, before noise dominates? (theta_m)",
    3: "3. horizon d: a small one reacts to noise, a large one delays the gain (d)",
    4: "4. gain at work: quick when J is large, at rest under noise (m, beta, DeltaT, lambda)",
}


@dataclass
class Innovation:
    """What drives theta, beside what noise alone would make of it. In units of J."""

    noise: float
    """J_noise ~ d sigma_v^2 + q d^2/2, q the process-noise intensity of the output."""
    late: float
    """99 % of the late J are below."""
    peak: float
    m: float
    rest: float
    """theta at which the gain rests under J = J_noise; infinite: it stays high."""
    beta: float
    """Smallest beta with which theta rests below 1.01 under J = J_noise; NaN: none does."""

    @property
    def suggested(self) -> tuple[float, float] | None:
        """Smallest and largest m with a factor of 3 to noise and to the peak; None: no room."""
        low, high = 3 * self.noise, self.peak / 3
        return (low, high) if low < high else None


@dataclass
class Measured:
    """One network in one run."""

    network: str
    seed: int
    gain: str
    """one, permanent or adaptive; mixed where its filters differ."""
    rms: float
    late: float
    """Error norm over the run and its late part, in the states' scales."""
    reached: float
    """Time until the error norm is below a tenth of its first value; infinite: never."""
    noise: float
    """Standard deviation of the late error about its moving mean, in the states' scales."""
    high: float
    """Part of the samples with theta above half of its largest value in the run; NaN: no gain that
    adapts."""
    innovation: Innovation | None
    """None where theta does not adapt and for other methods."""
    states: dict[str, tuple[float, float, float, float]]
    """rms, late, reached, noise by state, in its unit."""
    time: Floats
    J: Floats
    """(K, nodes) as drives theta."""
    theta: Floats
    """(K, nodes)."""


def measure(run: Run) -> list[Measured]:
    """All networks of a run."""
    tree, metrics = settings(run), evaluate(run)
    by_name = {str(one.get("name")): one for one in tree.get("networks") or []}
    found = []
    for network in run.networks:
        section = by_name.get(network.name, {}).get(SECTION)
        numbers = metrics.networks[network.name]
        error = pooled_errors(run, network)
        rough = roughness(run, error)
        scale = np.array([state.scale for state in run.states])
        states = {}
        for state, one in numbers.states.items():
            k = run.state(state)
            time = reached(run.truth.time, np.abs(error[:, k]))
            states[state] = (one.rmse, one.late_rmse, time, float(rough[k]))
        gain = gain_of(section)
        J, theta = (_diagnostic(network, name) for name in ("J driving theta", "theta"))
        moves = gain == "adaptive" and theta.size
        high = float(np.mean(theta > 0.5 * theta.max())) if moves else NAN
        found.append(
            Measured(
                network=network.name,
                seed=int(run.info.get("seed") or 0),
                gain=gain,
                rms=numbers.error_norm.rms,
                late=numbers.error_norm.late,
                reached=reached(run.truth.time, error_norm(error, scale)),
                noise=float(np.sqrt(np.nanmean((rough / scale) ** 2))),
                high=high,
                innovation=_innovation(run, network, tree, section, J),
                states=states,
                time=network.nodes[0].estimates.time,
                J=J,
                theta=theta,
            )
        )
    return found


def roughness(run: Run, error: Floats) -> Floats:
    """Standard deviation of the late error about its moving mean. error: (K, n); result: (n,).

    What a slow error leaves out: two filters with the same bias differ in it by their noise.
    """
    window = max(3, len(error) // SEEN)
    if len(error) < 2 * window:
        return np.full(error.shape[1], NAN)
    total = np.cumsum(np.vstack([np.zeros(error.shape[1]), error]), axis=0)
    mean = (total[window:] - total[:-window]) / window
    first = (window - 1) // 2
    middle = slice(first, first + len(mean))
    apart = (error[middle] - mean)[late(run.truth.time[middle])]
    result: Floats = np.sqrt(np.mean(apart**2, axis=0))
    return result


def reached(time: Floats, norm: Floats) -> float:
    """Time until a norm is below SETTLED of its first value; infinite if never. Both (K,).

    It counts by its root mean square over K/50 samples, so that one lucky sample does not.
    """
    window = max(1, len(norm) // 50)
    if len(norm) < window or not len(norm):
        return math.inf
    power = np.lib.stride_tricks.sliding_window_view(norm**2, window).mean(axis=1)
    below = np.flatnonzero(power < (SETTLED * norm[0]) ** 2)
    return float(time[below[0]] - time[0]) if len(below) else math.inf


def gain_of(section: dict[str, Any] | None) -> str:
    """What theta does in a network."""
    if section is None:
        return "-"
    kinds = {str(kind) for kind in section.get("gains") or [section.get("gain", "adaptive")]}
    return kinds.pop() if len(kinds) == 1 else "adaptive" if "adaptive" in kinds else "mixed"


def step_of(gain: str, keys: Sequence[str]) -> int | None:
    """The flowchart's step that numbers of a network belong to, when these keys are varied."""
    last = {key.rpartition(".")[2] for key in keys}
    return {"one": 1, "permanent": 2, "adaptive": 3 if last == {"d"} else 4}.get(gain)


def _diagnostic(network: Network, name: str) -> Floats:
    """A diagnostic of all nodes (K, nodes); (K, 0) where there is none."""
    columns = []
    for node in network.nodes:
        names = [signal.name for signal in node.diagnostics]
        if name in names:
            columns.append(node.estimates.diagnostic[:, names.index(name)])
    length = min((len(column) for column in columns), default=0)
    return np.stack([c[:length] for c in columns], axis=1) if columns else np.zeros((0, 0))


def _innovation(
    run: Run, network: Network, tree: dict[str, Any], section: dict[str, Any] | None, J: Floats
) -> Innovation | None:
    if section is None or not J.size or gain_of(section) != "adaptive":
        return None
    gains = section.get("gains") or ["adaptive"] * len(network.nodes)
    adaptive = [k for k, kind in enumerate(gains) if kind == "adaptive"]
    own = [noise_innovation(run, node, tree, float(section["d"])) for node in network.nodes]
    shared = section.get("innovation", "own") == "sum"
    noise = sum(own) if shared else max(own[k] for k in adaptive)
    driving = J[:, adaptive].max(axis=1)
    end = late(network.nodes[0].estimates.time[: len(driving)])
    m, theta_m = float(section["m"]), float(section["theta_m"])
    relax = float(section["lambda"]) * float(section["DeltaT"])
    return Innovation(
        noise=noise,
        late=float(np.quantile(driving[end], 0.99)),
        peak=float(driving.max()),
        m=m,
        rest=resting_gain(float(section["beta"]) * (noise - m), relax, theta_m),
        beta=(math.log(100) - math.log(relax)) / (m - noise) if m > noise and relax > 0 else NAN,
    )


def resting_gain(exponent: float, relax: float, theta_m: float) -> float:
    """Where theta comes to rest from above, with J held; infinite where it stays high.

    exponent = beta (J - m), so that mu/(1 - mu) = exp(exponent); relax = lambda DeltaT. Below
    theta_m the gain stands still where r theta^2 = theta - 1, r = mu/((1 - mu) lambda DeltaT). It
    falls as far as that only if it falls at theta_m, where its rise is fastest.
    """
    if relax <= 0:
        return math.inf
    r = math.exp(min(exponent, 700.0)) / relax
    if r * theta_m**2 >= theta_m - 1:
        return math.inf
    # the smaller root (1 - sqrt(1 - 4 r)) / (2 r), without cancellation
    return 2 / (1 + math.sqrt(1 - 4 * r))


def noise_innovation(run: Run, node: Node, tree: dict[str, Any], d: float) -> float:
    """J_noise ~ d sigma_v^2 + q d^2/2 of a node's first output, which is its first state.

    Process noise that is held over a sample of length T_s with variance s^2 has the intensity
    q = s^2 T_s.
    """
    noise = tree.get("noise") or {}
    period = float((run.info.get("time") or {}).get("period") or NAN)
    groups = (run.info.get("plant") or {}).get("groups") or []
    output = groups[node.groups[0]]["outputs"][0] if node.groups else node.node
    variance = _variance(noise.get("measurement"), output)
    intensity = _variance(noise.get("process"), node.states[0]) * period
    return d * variance + intensity * d**2 / 2


def _variance(noise: dict[str, Any] | None, channel: int) -> float:
    """Of one channel of a scenario's noise: uniform within a bound b has b^2/3."""
    kind = (noise or {}).get("distribution", "none")
    if noise is None or kind == "none":
        return 0.0
    scale = float(noise["scale"][channel])
    return scale**2 / 3 if kind == "uniform" else scale**2
