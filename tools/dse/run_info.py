"""What a log says of itself: the JSON objects of run_info (lcmtypes/README.md)."""

import json
from typing import Any

from dse.events import Messages
from dse.run import Signal

Sender = tuple[int, int]
"""Network and node."""
PLANT: Sender = (-1, 0)
"""The plant as a sender."""

NUMBER = (int, float)
_SIGNAL = {"name": str, "unit": str, "title": str, "scale": NUMBER}
_LINK = {"D": int, "T_m": int, "loss": NUMBER, "seed": str, "file": str, "outages": [[int]]}
_FORM: dict[str, Any] = {
    "plant": {
        "dse_version": str,
        "scenario": {
            "name": str,
            "title": str,
            "source": str,
            "yaml": str,
            "overrides": [str],
            "parts": [{"name": str, "text": str}],
        },
        "time": {"unit": str, "period": NUMBER, "samples": int},
        "plant": {
            "name": str,
            "title": str,
            "states": [_SIGNAL],
            "inputs": [_SIGNAL],
            "outputs": [_SIGNAL],
            "groups": [{"name": str, "outputs": [int]}],
        },
        "networks": [{"name": str, "title": str, "method": str, "nodes": int, "link": _LINK}],
        "type_hashes": {},
    },
    "node": {
        "name": str,
        "method": str,
        "method_title": str,
        "states": [int],
        "groups": [int],
        "neighbours": [int],
        "every": int,
        "frames": [[int]],
        "diagnostics": [{"name": str, "unit": str}],
        "storage_bytes": int,
        "source_run": int,
    },
}
"""What is used here of the two kinds; every member may be missing or null."""


def collect(messages: Messages) -> tuple[dict[Sender, dict[str, Any]], list[str]]:
    """Join the parts of each sender's object; and what is wrong with those that are left out."""
    texts: dict[Sender, dict[int, bytes]] = {}
    expected: dict[Sender, int] = {}
    for message in messages:
        header = message["header"]
        sender = (int(header["network"]), int(header["node"]))
        expected.setdefault(sender, int(message["parts"]))
        text = message["text"][: message["count"]].tobytes()
        texts.setdefault(sender, {}).setdefault(int(message["part"]), text)
    infos, faults = {}, []
    for sender, parts in texts.items():
        who = "the plant" if sender == PLANT else f"node {sender[1]} of network {sender[0]}"
        if (missing := expected[sender] - len(parts)) > 0:
            faults.append(f"run_info of {who} is not used: {missing} parts are missing")
            continue
        try:
            info = json.loads(b"".join(parts[part] for part in sorted(parts)))
            fault = _fault(info, _FORM["plant" if sender == PLANT else "node"], "it")
            if not fault and not isinstance(info, dict):
                fault = "it is null"
        except ValueError as error:
            fault = f"not JSON ({error})"
        if fault:
            faults.append(f"run_info of {who} is not used: {fault}")
        else:
            infos[sender] = info
    return infos, faults


def _fault(value: Any, form: Any, where: str) -> str | None:  # noqa: ANN401 - JSON
    """Where a JSON value is not of a form, None if it is."""
    if value is None:
        return None
    kind: Any = type(form) if isinstance(form, dict | list) else form
    if not isinstance(value, kind) or isinstance(value, bool):
        return f"{where} is {value!r:.40}"
    pairs: list[tuple[Any, Any, str]] = []
    if isinstance(value, dict):
        pairs = [(value.get(key), form[key], f"{where}.{key}") for key in form]
    elif isinstance(value, list):
        pairs = [(item, form[0], f"{where}[{i}]") for i, item in enumerate(value)]
        if None in value:
            return f"{where} holds null"
    return next((fault for pair in pairs if (fault := _fault(*pair))), None)


def signals(members: list[dict[str, Any]] | None) -> list[Signal]:
    """Signals of a list of {name, unit, title, scale}."""
    found = []
    for i, member in enumerate(members or []):
        scale = member.get("scale")
        found.append(
            Signal(
                name=str(member.get("name") or f"#{i}"),
                unit=str(member.get("unit") or ""),
                title=str(member.get("title") or ""),
                scale=float(scale) if scale is not None else float("nan"),
            )
        )
    return found
