# SPDX-License-Identifier: Apache-2.0
"""Tunables: values of trees that change while they run, with history and presets."""
