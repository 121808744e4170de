"""Options that commands share."""

from __future__ import annotations

from typing import Annotated, Optional

import typer

TASK = "A registered task, module:Class, gymnasium:ID, or a YAML file about one."
CONFIG = "Parameter file; else config/TASK.yaml, if there is one."
VEHICLE = Annotated[
    str, typer.Option(help="Namespace of the vehicle, where a bag has several; as /v1.")
]
RUN = Annotated[int, typer.Option(min=0, help="Run, from 1, where a bag has several.")]
TOPICS = Annotated[
    Optional[list[str]],
    typer.Option(help="A topic called otherwise, as state:=/joint_states; may be given again."),
]
