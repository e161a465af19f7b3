# SPDX-License-Identifier: Apache-2.0
"""The marketplace: calls for bids, ranks them, awards the run."""
