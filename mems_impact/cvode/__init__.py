"""The engine: CVODE behind one small contract. The only room that touches SUNDIALS."""
