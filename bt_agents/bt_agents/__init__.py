# SPDX-License-Identifier: Apache-2.0
"""A behaviour-tree agent runtime: one YAML file an agent, one marketplace a robot."""
