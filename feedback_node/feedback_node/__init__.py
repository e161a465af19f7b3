# SPDX-License-Identifier: Apache-2.0
"""The feedback node: mood rules, learning and the ledger of profiles."""
