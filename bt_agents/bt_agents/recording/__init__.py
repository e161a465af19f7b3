# SPDX-License-Identifier: Apache-2.0
"""Recording of what reaches a run from outside, and its replay."""
