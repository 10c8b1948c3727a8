"""Command lines and files that are wrong: a clear line, an exit code, no hanging."""

import re
import socket
from pathlib import Path

import pytest
from harness import Ended, Stage, dse, inproc, url_of

LIMIT = 30.0
"""No failure may take longer: nothing is run."""
LENGTH = ("--set", "time.duration_s=50")
SHIPPED = ("ahg-43_cstr2_continuous", "ahg-44_cstr2_communication", "ahg-45_cstr2_permanent_gain")


def refused(stage: Stage, *words: object) -> Ended:
    """Run a command that must fail with one line of its own."""
    ended = stage.run(*words, limit=LIMIT).failed()
    starts = f"{Path(str(words[0])).name}:"
    getopt = ("unrecognized option", "requires an argument")
    own = [
        line
        for line in ended.err.splitlines()
        if line.startswith(starts) or any(text in line for text in getopt)
    ]
    assert len(own) == 1, f"one line that tells what is wrong:\n{ended.err}"
    assert "log:" not in ended.out
    return ended


COMMAND_LINES = [
    # program, arguments, exit code, what the message must contain
    ("dse-run", "", 2, r"which scenario\? .*dse-run --list"),
    ("dse-run", "ahg-43 --nonsense", 2, "--nonsense"),
    ("dse-run", "ahg-43 --log", 2, "--?log"),
    ("dse-run", "ahg-43 --pace slowly", 2, "--pace slowly: must be lockstep, realtime or replay"),
    ("dse-run", "ahg-43 --seed x", 2, "--seed x: must be a whole number from 0 to"),
    ("dse-run", "ahg-43 --seed -1", 2, "--seed -1: must be a whole number from 0 to"),
    ("dse-run", "ahg-43 --seed 1e3", 2, "--seed 1e3: must be a whole number"),
    ("dse-run", "ahg-43 --seed 99999999999999999999", 2, "--seed 9+: must be a whole number"),
    ("dse-run", "ahg-43 --speed 0", 2, "--speed 0: must be a number greater than 0"),
    ("dse-run", "ahg-43 --speed nan", 2, "--speed nan: must be a number greater than 0"),
    ("dse-run", "ahg-43 --run-id 0", 2, "--run-id 0: must be a whole number from 1"),
    ("dse-run", "ahg-43 --set time.period_s", 2, "--set time.period_s: must be KEY=VALUE"),
    ("dse-run", "ahg-43 --set time.perod_s=1", 2, "time.perod_s: unknown key.*period_s"),
    ("dse-run", "ahg-43 --set time.period_s=-1", 2, "time.period_s.*-1"),
    ("dse-run", "ahg-43 ahg-44", 2, "ahg-44: only one scenario"),
    ("dse-run", "ahg-99", 2, "no scenario 'ahg-99'; there are: .*ahg-43_cstr2_continuous"),
    ("dse-run", "ahg", 2, "'ahg' fits several scenarios: .*ahg-43.*ahg-44"),
    ("dse-run", "./nowhere.yaml", 2, "./nowhere.yaml: No such file or directory"),
    ("dse-run", "ahg-43 --log nowhere/run.lcm", 2, "cannot write the log nowhere/run.lcm: No such"),
    ("dse-run", "ahg-43 --log .", 2, r"cannot write the log \.: Is a directory"),
    ("dse-run", "ahg-43 --inproc --log nowhere/run.lcm", 2, "cannot write the log nowhere/run.lcm"),
    ("dse-run", "ahg-43 --inproc --pace replay", 2, "--pace replay needs processes on a bus"),
    ("dse-run", "ahg-43 --replay run.lcm", 2, "--replay takes the scenario from the log"),
    ("dse-run", "--replay run.lcm --pace lockstep", 2, "--replay goes as fast as it can"),
    ("dse-run", "--replay text.lcm --log ./text.lcm", 2, "that is the log to be replayed"),
    ("dse-run", "--replay nowhere.lcm", 2, "cannot read the log nowhere.lcm: No such file"),
    ("dse-run", "--replay empty.lcm", 2, "empty.lcm: no run_info of a plant in it"),
    ("dse-run", "--replay text.lcm", 2, "text.lcm: no run_info of a plant in it"),
    ("dse-run", "ahg-43 --lcm-url tcp://x", 1, "cannot open the bus tcp://x: not a URL that LCM"),
    ("dse-run", "ahg-43 --lcm-url udpm://10.0.0.1:7667", 1, "must be a multicast address"),
    ("dse-run", "ahg-43 --lcm-url udpm://239.1.1.1:70000", 1, "port of 1 to 65535"),
    ("dse-estimator", "ahg-43", 2, r"which node\? Give --node N"),
    ("dse-estimator", "--node 0", 2, r"which scenario\?"),
    ("dse-estimator", "ahg-43 --node -1", 2, "--node -1: must be a whole number from 0 to"),
    ("dse-estimator", "ahg-43 --node one", 2, "--node one: must be a whole number"),
    ("dse-estimator", "ahg-43 --node 2", 2, "--node 2: the nodes of .*ahg-43.* are 0 to 1"),
    ("dse-estimator", "ahg-43 --node 0..2", 2, "--node 2: the nodes of .*ahg-43.* are 0 to 1"),
    ("dse-estimator", "ahg-43 --node 1..0", 2, "--node 0: must be a whole number from 1"),
    ("dse-estimator", "ahg-43 --node 0 --network nobody", 2, "--network nobody: .*no such network"),
    ("dse-estimator", "ahg-43 --node 0 --lcm-url udpm://10.0.0.1:1", 2, "a multicast address"),
    ("dse-plant", "ahg-43 --wait soon", 2, "--wait soon: must be a number greater than 0"),
    ("dse-plant", "ahg-43 --pace replay", 2, "--pace replay: the plant is lcm-logplayer then"),
    ("dse-plant", "ahg-99", 2, "no scenario 'ahg-99'"),
]  # fmt: skip


@pytest.mark.parametrize(("program", "words", "code", "tells"), COMMAND_LINES,
                         ids=[f"{one[0]} {one[1]}" for one in COMMAND_LINES])  # fmt: skip
def test_a_wrong_command_line_is_refused_in_one_clear_line(
    program: str, words: str, code: int, tells: str, stage: Stage
) -> None:
    (stage.folder / "empty.lcm").touch()
    (stage.folder / "text.lcm").write_text("this is not a log\n" * 1000)
    ended = refused(stage, dse(program), *words.split()).with_code(code)
    assert re.search(tells, ended.err), ended.err
    left = {path.name for path in stage.folder.rglob("*.lcm")}
    assert left == {"empty.lcm", "text.lcm"}, "nothing may be left behind"


@pytest.mark.parametrize("program", ["dse-run", "dse-estimator", "dse-plant"])
def test_an_occupied_port_is_named(program: str, stage: Stage) -> None:
    """Another program holds it and does not share it, as LCM programs do."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("", 0))
        port = other.getsockname()[1]
        node = ("--node", 0) if program == "dse-estimator" else ()
        log = ("--no-log",) if program == "dse-run" else ()
        ended = refused(stage, dse(program), "ahg-43", "--lcm-url", url_of(port), *node, *log)
    assert f"another program occupies UDP port {port}; choose another port with --lcm-url" in (
        ended.err
    )


def test_a_truncated_log_is_replayed_as_far_as_it_goes(stage: Stage, tmp_path: Path) -> None:
    log = inproc(stage, tmp_path / "whole.lcm", *LENGTH)
    content = log.read_bytes()
    cut = tmp_path / "cut.lcm"
    cut.write_bytes(content[: len(content) * 6 // 10])
    ended = stage.run(dse("dse-run"), "--replay", cut, "--quiet", limit=LIMIT).with_code(0)
    found = re.search(rf"{cut} holds (\d+) of the run's 50 samples", ended.err)
    assert found, ended.err
    samples = int(found[1])
    assert 10 < samples < 45
    equal = [int(n) for n in re.findall(r"all (\d+) estimates equal the recorded", ended.out)]
    assert len(equal) == 4
    assert all(samples - 1 <= n <= samples for n in equal)


def test_a_log_cut_off_at_the_beginning_is_refused(stage: Stage, tmp_path: Path) -> None:
    log = inproc(stage, tmp_path / "whole.lcm", *LENGTH)
    (tmp_path / "cut.lcm").write_bytes(log.read_bytes()[:1500])
    assert "no run_info of a plant" in refused(stage, dse("dse-run"), "--replay", "cut.lcm").err


def test_a_scenario_that_is_no_yaml_names_file_and_line(stage: Stage, tmp_path: Path) -> None:
    (tmp_path / "broken.yaml").write_text("name: x\ntime: {period_s: 1\n")
    assert re.search(r"broken\.yaml:\d+: ", refused(stage, dse("dse-run"), "./broken.yaml").err)


def test_dry_run_prints_who_would_talk_to_whom_and_starts_nothing(stage: Stage) -> None:
    told = stage.run(dse("dse-run"), "ahg-43", "--dry-run", limit=LIMIT).with_code(0).out
    assert "plant cstr2: 4 states, 2 inputs, 2 outputs in 2 sensor group(s); 1800 samples" in told
    for number, network in enumerate(("ahg", "ekf")):
        assert f"network {number}, {network}: 2 node(s)" in told
        for node, states in enumerate(("T1, C1", "T2, C2")):
            part = told.partition(f"node {node} (reactor {node + 1}) of network {network}")[2]
            assert f"estimates {states}\n" in part.partition("is heard by")[0]
            assert f"hears nodes {1 - node}\n" in part.partition("is heard by")[0]
    assert not list(stage.folder.rglob("*.lcm"))


def test_list_shows_every_shipped_scenario_with_its_title(stage: Stage) -> None:
    lines = stage.run(dse("dse-run"), "--list", limit=LIMIT).with_code(0).out.splitlines()
    for name in SHIPPED:
        (line,) = (line for line in lines if line.startswith(name))
        assert len(line.split()) > 3, "a title stands beside the name"
    assert not any(".yaml:" in line for line in lines), "every shipped scenario must be readable"


def test_keys_shows_the_keys_with_limits_and_defaults(stage: Stage) -> None:
    told = stage.run(dse("dse-run"), "--keys", limit=LIMIT).with_code(0).out
    key, kind, *_ = told.splitlines()[0].split()
    assert (key, kind) == ("key", "type")
    for line in (
        r"period_s +number +required +> 0 ",
        r"seed +whole number +0 ",
        r"give_up_s +number +20 +> 0 ",
        r"theta_m +number .*",
    ):
        assert re.search(rf"^ *{line}", told, re.MULTILINE), line


@pytest.mark.parametrize("program", ["dse-run", "dse-estimator", "dse-plant"])
def test_help_and_version(program: str, stage: Stage) -> None:
    told = stage.run(dse(program), "--help", limit=LIMIT).with_code(0).out
    assert told.startswith(f"usage: {program} ")
    for option in ("--set", "--lcm-url", "--pace", "--speed", "--version"):
        assert option in told
    version = stage.run(dse(program), "--version", limit=LIMIT).with_code(0).out
    assert re.fullmatch(r"dse \d+\.\d+\.\d+\n", version)
