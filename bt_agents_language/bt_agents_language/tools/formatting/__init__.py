# SPDX-License-Identifier: Apache-2.0
"""Files written in one canonical style, or changed in one place only."""
