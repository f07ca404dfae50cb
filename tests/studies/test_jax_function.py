"""Functions of runs in JAX against closed forms."""

import numpy as np
import pytest

import mems_impact as mi

jax = pytest.importorskip("jax")
jax.config.update("jax_enable_x64", True)

E, G, BOUNCES = 0.8, 9.8, 5  # restitution, gravity, and the bounces in the time of a run
GRADIENT = G * 2 * BOUNCES * E ** (2 * BOUNCES - 1)


@pytest.fixture(scope="module")
def ball():
    return mi.System(
        states=("x", "v"), flow=lambda mode, t, y, p: (y.v, -p.g), parameters={"g": G, "e": E},
        initial={"x": 1.0}, parts=[mi.Stopper("floor", "x", "v", lower=0.0, restitution="e")],
    )  # fmt: skip


@pytest.fixture(scope="module")
def energy(ball):
    def of(run):
        return G * run.final.x + run.final.v**2 / 2

    return mi.jax_function(ball, of, ["e"], duration=2.7)


@pytest.mark.slow(all=True)
@pytest.mark.parametrize("derivative", [jax.grad, jax.jacfwd, lambda f: jax.jit(jax.jacrev(f))])
def test_gradient_after_five_bounces(energy, derivative):
    assert abs(float(energy([E])) - G * E ** (2 * BOUNCES)) < 1e-9
    assert abs(float(derivative(energy)(jax.numpy.array([E]))[0]) - GRADIENT) < 1e-9


def test_a_batch_is_one_by_one(energy):
    values = np.linspace(0.79, 0.81, 7)[:, None]
    found, rates = jax.vmap(jax.value_and_grad(energy))(values)
    assert found.tolist() == [float(energy(value)) for value in values]
    exact = G * 2 * BOUNCES * values ** (2 * BOUNCES - 1)
    assert np.abs(rates - exact).max() < 1e-9


def test_several_numbers_and_nested_batches(ball):
    function = mi.jax_function(
        ball, lambda run: [run.final.x, run.final.v], ["e", "x0.x"], duration=1.0
    )
    point = jax.numpy.array([E, 1.0])
    matrix = jax.jacrev(function)(point)
    _, expected = mi.value_and_jacobian(
        ball, lambda run: [run.final.x, run.final.v], ["e", "x0.x"], duration=1.0
    )([E, 1.0])
    assert np.array_equal(matrix, expected)
    grid = jax.numpy.broadcast_to(point, (2, 3, 2))
    assert jax.vmap(jax.vmap(function))(grid).shape == (2, 3, 2)


def test_bad_input(ball, energy):
    with pytest.raises(mi.InvalidParameter, match="gravity"):
        mi.jax_function(ball, lambda run: run.final.x, ["gravity"], duration=1.0)
    with pytest.raises(mi.InvalidParameter, match=r"of shape \(1,\): e"):
        energy([E, 1.0])
    with pytest.raises(Exception, match="must be between 0 and 1; it is restitution of 'floor'"):
        energy([1.8])
