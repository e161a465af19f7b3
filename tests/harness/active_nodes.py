# SPDX-License-Identifier: Apache-2.0
"""Managed nodes that are active from the start, with settings as their process would read them."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from bt_agents.host.node import HostConfiguration, HostNode
from bt_agents_core.scene import SceneSpace
from bt_agents_language.files.folder_reader import Trees
from bt_agents_language.model.scene_specs import SceneSpec
from bt_agents_language.model.specs import Script
from feedback_node.ledger import Ledger
from feedback_node.node import FeedbackConfiguration, FeedbackNode
from feedback_node.simulated_feedback import SimulatedFeedback
from marketplace_node.node import MarketConfiguration, MarketplaceNode
from scene_layer.node import SceneLayerConfiguration, SceneLayerNode


def active_market(
    space: SceneSpace,
    epoch: str | None = None,
    *,
    overrides_file: Path | None = None,
    scenes_file: Path | None = None,
    **node_kwargs: Any,
) -> MarketplaceNode:
    """Return a market without rules."""
    configuration = MarketConfiguration(
        space=space, epoch=epoch, overrides_file=overrides_file, scenes_file=scenes_file
    )
    return MarketplaceNode(configuration, **node_kwargs)


def active_host(
    folder: Trees,
    *,
    tunings: str = "",
    open_goals: str = "",
    market: bool = True,
    **node_kwargs: Any,
) -> HostNode:
    """Return a host of the agents of a folder."""
    configuration = HostConfiguration(
        folder=folder, tunings=tunings, open_goals=open_goals, market=market
    )
    return HostNode(configuration, **node_kwargs)


def active_feedback(
    space: SceneSpace, ledger: Ledger, simulated: SimulatedFeedback | None = None
) -> FeedbackNode:
    """Return a feedback node; the caller that opened the ledger closes it."""
    return FeedbackNode(
        FeedbackConfiguration(space=space, ledger=lambda: nullcontext(ledger), simulated=simulated)
    )


def active_scene_layer(
    spec: SceneSpec,
    script: Script | None = None,
    *,
    memory: Path | None = None,
    ids: Callable[[], str] | None = None,
    **node_kwargs: Any,
) -> SceneLayerNode:
    """Return a scene layer that subscribes to sources, or plays a script."""
    given: dict[str, Any] = {} if ids is None else {"ids": ids}
    configuration = SceneLayerConfiguration(spec=spec, script=script, memory=memory, **given)
    return SceneLayerNode(configuration, **node_kwargs)
