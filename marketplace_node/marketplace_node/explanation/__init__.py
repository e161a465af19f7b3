# SPDX-License-Identifier: Apache-2.0
"""Reasons for decisions, in words and numbers."""
