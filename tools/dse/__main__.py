"""`python -m dse` is the command dse."""

import sys

from dse.cli import main

sys.exit(main())
