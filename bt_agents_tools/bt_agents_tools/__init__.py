# SPDX-License-Identifier: Apache-2.0
"""Tools for people: command line, launcher, rehearsals and tests of agents."""
