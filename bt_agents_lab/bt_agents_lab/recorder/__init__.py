# SPDX-License-Identifier: Apache-2.0
"""The journal: everything that a system said, in one MCAP file a day."""
