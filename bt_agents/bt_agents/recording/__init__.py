# SPDX-License-Identifier: Apache-2.0
"""Recording of all inputs of a run from outside, and their replay."""
