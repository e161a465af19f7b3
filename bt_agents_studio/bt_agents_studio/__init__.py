# SPDX-License-Identifier: Apache-2.0
"""Studio, which shows a running system, and recordings, in a browser."""
