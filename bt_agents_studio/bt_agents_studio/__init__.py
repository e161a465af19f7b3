# SPDX-License-Identifier: Apache-2.0
"""Studio: a running system, and what was recorded of one, for a browser."""
