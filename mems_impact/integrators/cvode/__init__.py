"""SUNDIALS CVODE: linear multistep methods. The only folder that touches SUNDIALS."""
