"""A bad network between two LCM buses: delays, reorders and duplicates datagrams.

    python relay.py GROUP PORT_A PORT_B SEED MAX_DELAY_S DUPLICATED

Forwards every datagram from one port to the other, unchanged, after a random delay of up to
MAX_DELAY_S, and a share DUPLICATED of them twice. Prints `relaying` when it listens, and on
SIGTERM how many datagrams it forwarded, how many of them later than a younger one, and how many
twice.
"""

import heapq
import random
import select
import signal
import socket
import sys
import time
from itertools import count
from types import FrameType


def listener(group: str, port: int) -> socket.socket:
    """A socket that hears what is sent to the group at the port."""
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 21)
    made.bind(("", port))
    member = socket.inet_aton(group) + socket.inet_aton("0.0.0.0")
    made.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
    return made


def speaker() -> socket.socket:
    """A socket that sends to this machine only."""
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
    made.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
    made.bind(("", 0))
    return made


class Stop(Exception):  # noqa: N818
    """SIGTERM came."""


def stop(number: int, frame: FrameType | None) -> None:
    """Signal handler."""
    raise Stop


def relay(group: str, ports: tuple[int, int], seed: int, delay: float, share: float) -> None:
    """Forward until stopped."""
    chance = random.Random(seed)
    ears = {listener(group, port): ports[1 - i] for i, port in enumerate(ports)}
    mouth = speaker()
    own = mouth.getsockname()[1]
    order = count()
    waiting: list[tuple[float, int, int, bytes]] = []
    newest = {port: -1 for port in ports}
    forwarded = reordered = duplicated = 0
    print("relaying", flush=True)
    try:
        while True:
            now = time.monotonic()
            while waiting and waiting[0][0] <= now:
                _, number, port, data = heapq.heappop(waiting)
                mouth.sendto(data, (group, port))
                forwarded += 1
                reordered += number < newest[port]
                newest[port] = max(newest[port], number)
            limit = max(0.0, waiting[0][0] - now) if waiting else 1.0
            for ear in select.select(list(ears), [], [], limit)[0]:
                data, sender = ear.recvfrom(65536)
                if sender[1] == own:
                    continue
                times = 1 + (chance.random() < share)
                duplicated += times - 1
                number = next(order)
                for _ in range(times):
                    due = time.monotonic() + chance.uniform(0, delay)
                    heapq.heappush(waiting, (due, number, ears[ear], data))
    except Stop:
        print(f"{forwarded} {reordered} {duplicated}", flush=True)


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, stop)
    _, group, first, second, seed, delay, share = sys.argv
    relay(group, (int(first), int(second)), int(seed), float(delay), float(share))
