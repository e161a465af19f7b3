# SPDX-License-Identifier: Apache-2.0
"""The tools for people: command line, launcher, rehearsals and tests of agents."""
