# SPDX-License-Identifier: Apache-2.0
"""The command `bt-agents`."""

from __future__ import annotations

import importlib.metadata
import sys

import click

from bt_agents.cli.ask import cancel, feedback, sense, status, trigger, why
from bt_agents.cli.check import check
from bt_agents.cli.experiment import experiment
from bt_agents.cli.explain import explain
from bt_agents.cli.fmt import fmt
from bt_agents.cli.groot import export, import_
from bt_agents.cli.live import demo, up
from bt_agents.cli.new import new
from bt_agents.cli.rehearse import rehearse
from bt_agents.cli.schema import schema
from bt_agents.cli.show import show
from bt_agents.cli.test import test
from bt_agents.errors import BtAgentsError


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(importlib.metadata.version("bt-agents"), prog_name="bt-agents")
def bt_agents() -> None:
    """Run interaction characters on a robot: one YAML file an agent, one market a robot."""


for _command in (
    demo,
    up,
    trigger,
    sense,
    cancel,
    status,
    why,
    feedback,
    experiment,
    check,
    explain,
    new,
    show,
    fmt,
    rehearse,
    test,
    schema,
    import_,
    export,
):
    bt_agents.add_command(_command)


def main() -> None:
    """Run the command line; an error on purpose is one message and exit code 1."""
    try:
        bt_agents()
    except BtAgentsError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(1)


if __name__ == "__main__":
    main()
