# SPDX-License-Identifier: Apache-2.0
"""Lets ``python -m scene_layer.node`` start the scene layer."""

from scene_layer.node import main

raise SystemExit(main())
