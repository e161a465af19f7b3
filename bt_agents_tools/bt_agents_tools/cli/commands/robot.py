# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents robot`: runs only the simulated robot, for a system elsewhere."""

from __future__ import annotations

from dataclasses import replace

import click

from bt_agents_ros.signals import Interrupt
from bt_agents_tools.cli.params_file import params_option
from bt_agents_tools.cli.run_parts import join_network, lan_options, run_parts
from bt_agents_tools.launcher import components
from bt_agents_tools.launcher.log_files import new_log_folder
from bt_agents_tools.launcher.parameter_file import ParameterFile


@click.command()
@click.option("--voice/--no-voice", default=True, help="Speak aloud when espeak-ng is installed.")
@params_option
@lan_options
def robot(voice: bool, params: ParameterFile | None, lan: bool, slow_network: float) -> None:
    """Run the simulated robot for a system, which may run on another machine."""
    interrupt = Interrupt()
    logs = new_log_folder()
    join_network(lan, slow_network)
    part = components.robot("auto" if voice else "off")
    part = components.on_slow_network(replace(part, file=params), slow_network)
    run_parts("robot", [part], interrupt, logs)
