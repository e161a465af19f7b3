# SPDX-License-Identifier: Apache-2.0
"""The ledger: every revision of every profile, durable before it is acknowledged."""
