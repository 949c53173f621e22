# SPDX-License-Identifier: Apache-2.0
"""One cable between two clamps: elements, energy, the warm step, its error, its stiffness."""
