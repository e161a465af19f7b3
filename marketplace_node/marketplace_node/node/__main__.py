# SPDX-License-Identifier: Apache-2.0
"""Lets ``python -m marketplace_node.node`` start the marketplace."""

from marketplace_node.node import main

raise SystemExit(main())
