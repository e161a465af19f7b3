# SPDX-License-Identifier: Apache-2.0
"""Specifications: what a checked file says, as frozen data."""
