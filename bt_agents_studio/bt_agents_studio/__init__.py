# SPDX-License-Identifier: Apache-2.0
"""Studio: shows a running system, and recordings of one, in a browser."""
