# SPDX-License-Identifier: Apache-2.0
"""Rehearsals: trees played without a robot, and their tests."""
