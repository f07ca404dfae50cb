"""The actuator as a system of parts: dry friction of the frame, stoppers of the block.

A mode is a pair of friction (the frame stuck, sliding forward, sliding backward) and contact (the
block free, resting on the right stopper, resting on the left one), and for each limited rate
whether it is within its limit. With compliant stoppers, the modes "right" and "left" are contacts
in which the force increases with the depth.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from typing import Any

from mems_impact.actuator import equations as eq
from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.energy_accounting import SUMMED, accounts, sum_of
from mems_impact.actuator.model import LimitedState, Model, compose, zero
from mems_impact.actuator.terms.base import Function, TermKind
from mems_impact.hybrid.automaton import GENERATED, Automaton, Guard
from mems_impact.hybrid.definition import Definition, automaton_of, ending, function, named_tuple
from mems_impact.systems.components.assembly import AssembledSystem, assemble
from mems_impact.systems.components.base import Part
from mems_impact.systems.components.friction import Friction
from mems_impact.systems.components.rate_limit import RateLimit
from mems_impact.systems.components.stopper import Stopper

STUCK, FORWARD, BACKWARD = 0, 1, 2
FREE, RIGHT, LEFT = 0, 1, 2

FRICTION = ("stuck", "forward", "backward")
CONTACT = ("free", "right", "left")
MODES = tuple(f"{friction}-{contact}" for contact in CONTACT for friction in FRICTION)

RIGHT_IMPACT, LEFT_IMPACT, RELEASE, SLIP_END, BREAK_AWAY = 0, 1, 2, 3, 4
# Order of simultaneous events: impacts first, since they change the velocities that the other
# margins depend on; release before slip end, since it changes the load on the frame.
GUARDS = (
    Guard("right impact", order=0, impact=True),
    Guard("left impact", order=1, impact=True),
    Guard("release", order=2, condition=True),
    Guard("slip end", order=3, condition=True),
    Guard("break-away", order=4, condition=True),
)
IMPACTS = tuple(guard.name for guard in GUARDS if guard.impact)
MARGIN_UNITS = {
    "right impact": "m", "left impact": "m", "release": "N", "slip end": "m/s", "break-away": "N",
    "current limit": "A", "left current limit": "A",
}  # fmt: skip


def mode_of(friction: int, contact: int) -> int:
    """Return the mode of a pair of friction and contact."""
    return 3 * contact + friction


def slips(mode: str) -> bool:
    """Return whether the frame slips in a mode, by its name."""
    return not mode.startswith(FRICTION[STUCK])


def direction_of(mode: int) -> int:
    """Return the sign of the slip velocity in `mode`, 0 where the frame is stuck."""
    friction = mode % 3
    return 1 if friction == FORWARD else (-1 if friction == BACKWARD else 0)


def side_of(mode: int) -> int:
    """Return +1 where the block rests on the right stopper, -1 on the left one, 0 if free."""
    contact = mode // 3 % 3
    return 1 if contact == RIGHT else (-1 if contact == LEFT else 0)


# --- Parts and flow

FROM_PARTS = (2, 3, 4, 0, 1)  # the guards in the order of `GUARDS`: friction is the first part


@dataclass(frozen=True)
class Waveforms:
    """The waveforms ``voltage(t, q)`` of a drive at the electrodes, and of a clamp."""

    right: Function
    left: Function | None = None
    clamp: Function | None = None

    @classmethod
    def of(cls, drive: Drive) -> Waveforms:
        """Return the waveforms of a drive."""
        return cls(drive.voltage, drive.left_voltage, drive.clamp_voltage)

    @property
    def electrodes(self) -> int:
        """Count of electrodes that pull the block."""
        return 1 if self.left is None else 2

    def lines(self, model: Model, names: str) -> tuple[str, ...]:
        """Return lines that assign the values at time t to three names, 0 without a waveform."""
        return tuple(
            f"{name} = {f'{kind}(t, p[{model.layout.drive}:])' if wave else '0.0'}"
            for name, (kind, wave) in zip(names, vars(self).items(), strict=True)
        )


def parts_of(model: Model, waveforms: Waveforms) -> list[Part]:
    """Return the parts of an actuator, in the order of the digits of a mode."""
    lines = waveforms.lines(model, "vwu") if model.clamp_driven else ("v = w = u = 0.0",)
    frame = Friction(
        "frame",
        "v1",
        mu=model.friction,
        normal=generated(
            "normal(t, y, p)",
            "force(v, w, u, p)",
            *lines,
            force=model.normal_force,
            **vars(waveforms),
        ),
        static=eq.mu_s,
        sticks=model.sticks,
    )
    block = Stopper(
        "block",
        "x2",
        "v2",
        upper=eq.right_stopper,
        lower=eq.left_stopper,
        restitution=None if model.stopper else model.restitution,
        law=model.stopper,
        adhesion=model.adhesion or 0.0,
        against="v1",
    )
    sources = (
        RateLimit(
            name_of(each).replace(" ", "_"),
            model.layout.states[each.state],
            limit=each.limit.max_rate,
        )
        for each in model.limits
    )
    return [frame, block, *sources]


def name_of(limited: LimitedState) -> str:
    """Return the name of the event at which a rate reaches its limit."""
    return f"{limited.side}{limited.limit.event}"


def flow_of(
    model: Model,
    waveforms: Waveforms,
    dissipation: Mapping[str, Function] | None,
) -> Callable[..., Any]:
    """Return the flow without the parts; with dissipated powers, with sums of works and losses."""
    # A sum with zero would take as long as any other.
    force, on_frame, on_block = (
        "" if getattr(model, name) is zero else f"{name}(y, p)"
        for name in ("force", "on_frame", "on_block")
    )
    lines = [
        *waveforms.lines(model, "vwu")[: 2 if dissipation is None else 3],
        "pulled = pull(v, w, y, p)",
        f"inner = load(y[X2], y[V2], pulled{force and f' + {force}'}, p)",
        # Reciprocals need not wait for the load, as quotients would.
        f"a1 = (inner{on_frame and f' + {on_frame}'}) * (1.0 / p[M1])",
        f"a2 = ({on_block} - inner) * (1.0 / p[M2])",
    ]
    rates = {f"rate_{i}": rate for i, rate in enumerate(model.rates)}
    losses = {f"loss_{i}": loss for i, loss in enumerate((dissipation or {}).values())}
    values = ["y[V1]", "a1", "y[V2]", "a2 - a1", *(f"{rate}(v, w, y, p)" for rate in rates)]
    if dissipation is not None:
        values += ["pulled * y[V2]", "mode.frame * y[V1]"]
        sliding = "sliding(mode.frame, y[V1], normal(v, w, u, p), p) * y[V1]"
        values += [sliding, "p[C] * y[V2] * y[V2]"]
        values += [f"{loss}(v, w, y, p)" for loss in losses]
    return generated(
        "flow(mode, t, y, p)",
        f"({', '.join(values)})",
        *lines,
        **{name: getattr(eq, name) for name in ("load", "V1", "X2", "V2", "M1", "M2", "C")},
        **{name: getattr(model, name) for name in ("pull", "force", "on_frame", "on_block")},
        **rates,
        **losses,
        **vars(waveforms),
        normal=model.normal_force,
        sliding=model.sliding_friction,
    )


def generated(head: str, value: str, *lines: str, **space: Any) -> Callable[..., Any]:
    """Return a function with these lines, which returns a value."""
    space |= {"__name__": __name__, "SOURCE": function(head, [*lines, f"return {value}"])}
    exec(compile(space["SOURCE"], GENERATED, "exec"), space)
    result: Callable[..., Any] = space[head.partition("(")[0]]
    return result


# --- Automaton


@cache
def assembled_device(
    kinds: tuple[TermKind, ...],
    waveforms: Waveforms,
    *,
    summed: bool,
) -> tuple[Model, tuple[str, ...], AssembledSystem]:
    """Return the model of a device, its states, and its parts with its flow."""
    model = compose(kinds, waveforms.electrodes)
    dissipation = accounts(kinds, waveforms.electrodes).dissipation if summed else None
    sums = () if dissipation is None else (*SUMMED, *dissipation)
    states = (*model.layout.states, *map(sum_of, sums))
    assembled = assemble(
        parts_of(model, waveforms),
        flow=flow_of(model, waveforms, dissipation),
        states=states,
        parameters=(),
        masses={"v1": eq.frame_mass, "v1 + v2": eq.block_mass},
        guards=(),
        time_scale=1.0,
    )
    return model, states, assembled


def device_definition(
    kinds: tuple[TermKind, ...],
    waveforms: Waveforms,
    *,
    summed: bool = False,
    until: tuple[Callable[..., Any], tuple[float, ...], tuple[str, ...]] | None = None,
) -> Definition:
    """Return the definition of an actuator with terms of these kinds under waveforms.

    `waveforms` are scalar functions of time and the drive's parameters (see
    `mems_impact.actuator.drives.base.Drive`). With `summed`, works and losses are additional states
    (see `mems_impact.actuator.energy_accounting`). `until` is a function of the user whose zero
    ends a run, with the units of the states of the actuator, of time and of its parameters, and the
    names of these parameters.
    """
    model, states, assembled = assembled_device(kinds, waveforms, summed=summed)
    added = range(len(model.layout.states), len(states))
    definition = Definition(
        states=states,
        modes=mode_names(model),
        parameters=(),
        array_size=model.layout.hidden,
        flow=assembled.flow,
        guards=guards_of(model, assembled),
        # The state may be one from which a run starts.
        switch_transition=generated(
            "switched(mode, t, y, p)", "begin(mode, t, y, p), y", begin=assembled.composition.begin
        ),
        cyclic=(*model.cyclic, *added),
        constrained=assembled.constrained,
        projection=assembled.projection,
    )
    if until is None:
        return definition
    margin = in_units_of_the_user(until[0], states, *until[1:])
    # The function may depend on the position of the frame.
    return replace(ending(definition, margin), cyclic=())


def guards_of(model: Model, assembled: AssembledSystem) -> tuple[Guard, ...]:
    """Return the guards with the names and the order of `GUARDS`, then those of limited rates."""
    names = (*(guard.name for guard in GUARDS), *map(name_of, model.limits))
    order = (*FROM_PARTS, *range(len(GUARDS), len(names)))
    return tuple(
        replace(assembled.guards[place], name=name, order=i)
        for i, (place, name) in enumerate(zip(order, names, strict=True))
    )


def mode_names(model: Model) -> tuple[str, ...]:
    """Return the names of all modes."""
    suffixes = [
        ("", *(f"-{each.side.replace(' ', '-')}{name}" for name in each.limit.modes))
        for each in model.limits
    ]
    return tuple(
        f"{mode}{''.join(reversed(limited))}"
        for limited in product(*reversed(suffixes))
        for mode in MODES
    )


@cache
def device_automaton(
    bounds: bool,
    kinds: tuple[TermKind, ...],
    waveforms: Waveforms,
    summed: bool,
    until: Any,
) -> Automaton:
    """Return the automaton of a `device_definition`, with or without checks of array bounds."""
    return replace(
        automaton_of(device_definition(kinds, waveforms, summed=summed, until=until)),
        stiff=any(kind.term.stiff for kind in kinds),
        bounds=bounds,
        recipe=(device_automaton, (bounds, kinds, waveforms, summed, until)),
    )


def in_units_of_the_user(
    until: Function, states: tuple[str, ...], units: tuple[float, ...], names: tuple[str, ...]
) -> Function:
    """Return `until` as a function of arrays in scaled units."""
    n = len(units) - len(names) - 1  # sums are no states of the user
    y = ", ".join(f"y[{i}] * {units[i]!r}" for i in range(n))
    p = ", ".join(f"p[{i}] * {unit!r}" for i, unit in enumerate(units[n + 1 :]))
    return generated(
        "margin(mode, t, y, p)",
        f"until(mode, t * {units[n]!r}, State({y}), Parameters({p}))",
        until=until,
        State=named_tuple("State", states[:n]),
        Parameters=named_tuple("Parameters", names),
    )
