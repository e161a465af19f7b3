# SPDX-License-Identifier: Apache-2.0
"""Agents whose files change while they are at work: what is read again, and what it replaces."""
