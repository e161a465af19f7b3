# SPDX-License-Identifier: Apache-2.0
"""The journal: every message of a system, recorded to MCAP files."""
