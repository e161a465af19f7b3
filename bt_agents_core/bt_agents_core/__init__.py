# SPDX-License-Identifier: Apache-2.0
"""Bt agents core."""
