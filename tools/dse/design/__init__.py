"""What is worked out on a desk before a run: sub-commands of `dse design`.

To add one: a module with NAME, HELP, configure(parser) and run(arguments), as those in
dse/commands, and its name in COMMANDS. Modules import heavy libraries (casadi, scipy, matplotlib)
in the functions that need them, so that `dse --help` stays quick.
"""

from types import ModuleType

from dse.design import (
    bounds,
    functional,
    graph,
    identify,
    linearise,
    luenberger,
    mhe_check,
    normal_form,
    observability,
    pod,
    qp,
    tune,
    uio,
)

COMMANDS: tuple[ModuleType, ...] = (
    normal_form,
    observability,
    linearise,
    mhe_check,
    qp,
    identify,
    tune,
    bounds,
    uio,
    functional,
    luenberger,
    graph,
    pod,
)
