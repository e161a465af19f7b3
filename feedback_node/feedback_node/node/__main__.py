# SPDX-License-Identifier: Apache-2.0
"""Lets ``python -m feedback_node.node`` start the feedback node."""

from feedback_node.node import main

raise SystemExit(main())
