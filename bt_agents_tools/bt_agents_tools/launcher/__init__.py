# SPDX-License-Identifier: Apache-2.0
"""The processes of a running system: how they are started, restarted and ended."""
