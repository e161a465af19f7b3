# SPDX-License-Identifier: Apache-2.0
"""Behaviours of the node types, one module each; ``BEHAVIOURS`` names the keys."""
