# SPDX-License-Identifier: Apache-2.0
"""Typed requests to a running system."""
