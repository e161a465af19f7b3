# SPDX-License-Identifier: Apache-2.0
"""Journal of all messages of a system, in one MCAP file for each start and day."""
