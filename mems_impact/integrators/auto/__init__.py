"""Two methods in one: the explicit one-step method, and CVODE's BDF where the flow is stiff."""
