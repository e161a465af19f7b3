# SPDX-License-Identifier: Apache-2.0
"""Hosts of the market: who is alive, who may be asked, what lost hosts leave open."""
