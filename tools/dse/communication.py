"""What communication costs: a model of radio frames beside what the log shows.

The model is that of the adaptive distributed observers (section 2.3 of their source): every value
that a node takes from a neighbour travels over their link in a frame of its own, of IEEE 802.15.4
size with the shortest address field, with 4 bytes a value. A network on a bus says a message once
for all who listen: therefore the counts of the log are others.
"""

from dataclasses import dataclass

from dse.run import Network

FRAME_BYTES = 7
"""5 of the header (frame control 2, sequence number 1, address 2), 2 of the check sequence."""
VALUE_BYTES = 4


def frame_bytes(values: int) -> int:
    """Size of a frame with so many values."""
    return FRAME_BYTES + VALUE_BYTES * values


@dataclass
class Communication:
    """What a network says in a sample; None where its nodes do not tell or the log has nothing."""

    links: int
    """Directed: who hears whom."""
    frames: int | None
    """One per link and message that is meant for it."""
    frame_bytes: int | None
    """Of all frames, by the model."""
    messages: float
    """As the nodes counted them: said once for all who listen."""
    payload_bytes: float
    """Of these, 8 bytes a value."""
    wire_bytes: float
    """In the log as encoded: padded to the types' capacities, repetitions included."""


def communication(network: Network) -> Communication:
    """Cost of a network per sample."""
    frames = [values for node in network.nodes for _, values in node.frames]
    told = bool(frames) or not any(node.neighbours for node in network.nodes)
    samples = max([1, *(len(node.done.sample) for node in network.nodes)])
    return Communication(
        links=sum(len(node.neighbours) for node in network.nodes),
        frames=len(frames) if told else None,
        frame_bytes=sum(map(frame_bytes, frames)) if told else None,
        messages=sum(int(node.done.sent.sum()) for node in network.nodes) / samples,
        payload_bytes=sum(int(node.done.sent_bytes.sum()) for node in network.nodes) / samples,
        wire_bytes=sum(node.exchanges.wire_bytes for node in network.nodes) / samples,
    )
