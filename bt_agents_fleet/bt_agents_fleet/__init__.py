# SPDX-License-Identifier: Apache-2.0
"""Robots of a fleet that learn together: their ledgers over a PostgreSQL database."""
