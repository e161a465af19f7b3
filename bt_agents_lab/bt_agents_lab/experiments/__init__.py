# SPDX-License-Identifier: Apache-2.0
"""Experiments on selection and learning: simulated worlds, measures, claims and figures."""
