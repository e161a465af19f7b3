# SPDX-License-Identifier: Apache-2.0
"""Rehearsals: trees that run without a robot, and their tests."""
