# SPDX-License-Identifier: Apache-2.0
"""On_failure: runs a handler when a node has failed."""

from __future__ import annotations

from bt_agents.engine.nodes.selector import LightSelector


class OnFailure(LightSelector):
    """A selector with memory and two children: the node, and the handler for its FAILURE.

    The failure is handled: the node has the status of the handler.
    """


BEHAVIOURS = {"on_failure": OnFailure}
