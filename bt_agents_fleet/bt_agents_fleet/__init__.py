# SPDX-License-Identifier: Apache-2.0
"""Learning in a fleet of robots: synchronises their ledgers over a PostgreSQL database."""
