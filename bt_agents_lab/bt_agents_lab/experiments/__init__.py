# SPDX-License-Identifier: Apache-2.0
"""The paper's experiments, and sweeps over strategies and learning rates."""
