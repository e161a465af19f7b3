# SPDX-License-Identifier: Apache-2.0
"""Learning: cards, update rules, profiles and their layers."""
