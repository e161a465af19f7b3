# SPDX-License-Identifier: Apache-2.0
"""One round of the auction: bids, ranking, decision."""
