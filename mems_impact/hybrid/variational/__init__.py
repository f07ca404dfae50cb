"""Variational equations through events: sensitivities and Lyapunov exponents."""
