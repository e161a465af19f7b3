# SPDX-License-Identifier: Apache-2.0
"""Records runs, and replays them without the outside: each file holds both sides of one proxy."""
