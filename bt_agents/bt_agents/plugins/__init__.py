# SPDX-License-Identifier: Apache-2.0
"""Behaviours of other packages as leaves."""
