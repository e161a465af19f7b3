# SPDX-License-Identifier: Apache-2.0
"""Kinds of files, each with the field table for reading it."""

from __future__ import annotations

from collections.abc import Mapping

from bt_agents_language.files.agent_reader import AGENT
from bt_agents_language.files.experiment_reader import EXPERIMENT
from bt_agents_language.files.libraries import LIBRARY
from bt_agents_language.files.market_reader import MARKET
from bt_agents_language.files.preset_reader import PRESET
from bt_agents_language.files.scene_reader import SCENE
from bt_agents_language.files.script_reader import SCRIPT
from bt_agents_language.files.testing.test_reader import TEST
from bt_agents_language.files.texts_reader import TEXTS
from bt_agents_language.yaml.field_tables import FileKind

FILE_KINDS: Mapping[str, FileKind] = {
    kind.name: kind
    for kind in (AGENT, LIBRARY, TEST, SCENE, MARKET, SCRIPT, TEXTS, PRESET, EXPERIMENT)
}
