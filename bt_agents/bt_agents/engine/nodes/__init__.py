# SPDX-License-Identifier: Apache-2.0
"""Behaviours of the node types, one file each, which names its keys in ``BEHAVIOURS``."""
