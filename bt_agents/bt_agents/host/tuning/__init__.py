# SPDX-License-Identifier: Apache-2.0
"""Tunables: values of trees that can change during a run, with history and presets."""
