# SPDX-License-Identifier: Apache-2.0
"""Kinds of files that the installed packages read, including the lab."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module

from bt_agents_language.files.file_kinds import FILE_KINDS
from bt_agents_language.yaml.field_tables import FileKind


def installed_kinds() -> Mapping[str, FileKind]:
    """Return the kinds of files by name; without the lab, sweeps are missing."""
    try:
        # The lab is an optional extra.
        lab = import_module("bt_agents_lab.experiments.sweep_reader")
    except ModuleNotFoundError:
        return FILE_KINDS
    return {**FILE_KINDS, "sweep": lab.SWEEP}
