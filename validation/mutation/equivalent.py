"""Mutants that change nothing that could be seen, each with the reason; known by their text."""

from __future__ import annotations

# (path, what stood there, what stands there now): why no test can tell.
EQUIVALENT: dict[tuple[str, str, str], str] = {
    (
        "mems_impact/continuation/arclength.py",
        "guess = start + (bound - start[-1]) / (end[-1] - start[-1]) * (end - start)",
        "guess = start + (bound - start[-1]) / ((end[-1] + start[-1])) * (end - start)",
    ): "a guess: Newton's method converges to the same point",
    (
        "mems_impact/continuation/codimension_two.py",
        "for order in range(2, 6):",
        "for order in range(2, 7):",
    ): "terms of order six are computed and not used",
    (
        "mems_impact/continuation/equilibrium_branch.py",
        "if len(self.branch.points) <= PREDICTOR_POINTS or not 0.0 < position <= length:",
        "if (len(self.branch.points) < PREDICTOR_POINTS) or not 0.0 < position <= length:",
    ): "no branch has come round after so few steps",
    (
        "mems_impact/continuation/orbit_branch.py",
        "return FOLD if multiplier.real > 0.0 else PERIOD_DOUBLING",
        "return FOLD if multiplier.real > 1.0 else PERIOD_DOUBLING",
    ): "a multiplier passes 1 where the branch turns, which names a fold before",
    (
        "mems_impact/hybrid/diagnostics/failures.py",
        'named_tuple("Parameters", definition.parameters)(*[0.0] * len(definition.parameters))',
        'named_tuple("Parameters", definition.parameters)(*[1.0] * len(definition.parameters))',
    ): "only the type of the numbers is asked for",
    (
        "mems_impact/hybrid/event_loop/event_detection.py",
        "TINY_BIAS = 1e-300  # bias of a margin that starts at zero",
        "TINY_BIAS = 1e-297  # bias of a margin that starts at zero",
    ): "far below the rounding of any margin either way",
    (
        "mems_impact/hybrid/engine.py",
        "self.table = binding.table(workspace.ROWS, max(n, 2 * m, switches))",
        "self.table = binding.table(workspace.ROWS, max(n, 3 * m, switches))",
    ): "a table with room to spare",
    (
        "mems_impact/hybrid/variational/saltation.py",
        "b = a + width if a + 1.5 * width < t else t",
        "b = a + width if a + 1500.0 * width < t else t",
    ): "what is not certain of the rest of a step is found in finer parts",
    (
        "mems_impact/hybrid/variational/saltation.py",
        "state.y[j] = 0.0 if problem.cyclic[j] == 1 else values[first + j]",
        "state.y[j] = 1.0 if problem.cyclic[j] == 1 else values[first + j]",
    ): "a cyclic component enters no function; any small number does",
    (
        "mems_impact/hybrid/variational/saltation.py",
        "if quota <= 0:",
        "if quota <= 1:",
    ): "a call that pauses sooner is called again",
    (
        "mems_impact/orbits/family.py",
        "scales[j] = float(np.abs(p_rate).max()) or 1.0",
        "scales[j] = float(np.abs(p_rate).max()) or 1000.0",
    ): "it scales derivatives by a parameter that nothing depends on: zeros",
}
