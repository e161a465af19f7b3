# SPDX-License-Identifier: Apache-2.0
"""Ranking by an external service over HTTP."""
