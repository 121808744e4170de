"""`python -m iolspi_ros` is `iolspi`."""

import sys

from iolspi_ros.cli import main

sys.exit(main())
