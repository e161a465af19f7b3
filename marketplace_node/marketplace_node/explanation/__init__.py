# SPDX-License-Identifier: Apache-2.0
"""Reasons for decisions as texts for people."""
