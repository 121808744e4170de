"""The `iolspi` command."""

from __future__ import annotations

import sys

from iolspi_ros.environment import no_ros
from iolspi_ros.errors import InputError
from iolspi_ros.process import prepare


def main() -> int:
    """Run the command; bad input is said in one line, with status 2."""
    prepare()
    from iolspi_ros.cli import (  # noqa: F401  they add themselves
        bench,
        cockpit,
        compare,
        demo,
        demos,
        doctor,
        fly,
        joystick,
        learn,
        manage,
        new_task,
        record,
        reproduce,
        run,
        sitl,
        soak,
        up,
        watch,
    )
    from iolspi_ros.cli.app import app

    try:
        app()
    except InputError as error:
        print(f"iolspi: {error}", file=sys.stderr)
        return 2
    except ImportError as error:
        if (said := no_ros(error)) is None:
            raise
        print(f"iolspi: {said}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("iolspi: interrupted", file=sys.stderr)
        return 130
    return 0
