"""One cable between two clamps: elements, energy, the warm step, its error, its stiffness."""
