# SPDX-License-Identifier: Apache-2.0
"""Learning: cards, rules of update, profiles and their layers."""
