# SPDX-License-Identifier: Apache-2.0
"""The formatter of YAML files and edits of single values in place."""
