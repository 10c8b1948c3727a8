"""dse: reads the LCM event logs of distributed state estimation runs.

The command `dse` is dse.cli; as a library, start with `dse.log.read`.
"""

__version__ = "0.1.0"
